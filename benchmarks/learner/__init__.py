"""The learner's benchmark: data, rivals, timing, report. `python -m benchmarks.learner.run --help` says more."""

import os

# One thread for everybody. OpenMP, BLAS and faiss read it when they are loaded, so it stands before any of them is.
os.environ["OMP_NUM_THREADS"] = "1"
