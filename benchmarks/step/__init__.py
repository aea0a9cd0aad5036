"""What one look-think-move step costs outside rendering and motion."""

import os

# Before numpy is imported, and as `handeye` has it for its own processes.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
