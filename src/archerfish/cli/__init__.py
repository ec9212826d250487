"""The command line, one short file per command: options → one call that a Python user can make → print."""
