"""The command line, one short file per command."""

import os

# Read by the libraries when they are first imported, so it is set before any of them.
# Many threads make the small matrix products of an identification five to ten times slower on shared cores.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
# Warnings of JAX and XLA (an idle graphics card, a slow compilation) would stand between the lines of a command.
os.environ.setdefault("JAX_LOGGING_LEVEL", "ERROR")
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")
