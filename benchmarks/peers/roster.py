"""Who is compared: every tool that identifies a linear state space from logs and installs from PyPI or Debian."""

from typing import NamedTuple

MUJOCO = "estimates the parameters of a given MuJoCo model (grey box), and no mechanical model belongs to these logs"


class Tool(NamedTuple):
    """A tool and what is reported of it."""

    name: str
    """What it is called in tables."""
    adapter: str
    """Its script in this folder."""
    entries: dict[str, tuple[str, ...]]
    """Reported setting → the adapter's variants; of several, the one that fits the training part best is taken."""
    requirements: str = ""
    """Its pinned packages in this folder; empty for a program that must be on the PATH, and for our own."""


OURS = Tool("Archerfish", "archerfish_fit.py", {"order 4": ("identify_axis",), "order chosen": ("choose_order",)})
PEERS = (
    Tool("Octave n4sid", "octave_fit.m", {"default s": ("default s",), "s = 25": ("s = 25",)}),
    Tool(
        "nfoursid",
        "nfoursid_fit.py",
        {"10 block rows": ("10 block rows",), "20 block rows": ("20 block rows",)},
        "nfoursid.txt",
    ),
    Tool("SIPPY", "sippy_fit.py", {"best of 4 methods": ("N4SID", "MOESP", "CVA", "PARSIM-K")}, "sippy.txt"),
    Tool(
        "ctrlsys",
        "ctrlsys_fit.py",
        {"20 block rows": ("20 block rows",), "25 block rows": ("25 block rows",)},
        "ctrlsys.txt",
    ),
    Tool(
        "jax-sysid",
        "jax_sysid_fit.py",
        {
            "introduction": ("introduction",),
            "1 start": ("seed 0",),
            "4 starts": ("seed 0", "seed 1", "seed 2", "seed 3"),
        },
        "jax_sysid.txt",
    ),
)
NOT_RUN = {"mujoco.sysid": MUJOCO}
"""Tool → why it can't be run on these logs."""
