"""Before anything imports numpy: one thread in the linear algebra libraries, as in the command itself."""

import os

for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
