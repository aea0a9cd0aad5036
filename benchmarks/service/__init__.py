"""How fast the service answers, beside what does nothing and beside the library; see benchmarks/README.md."""
