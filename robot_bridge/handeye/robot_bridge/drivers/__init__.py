"""Robot drivers; each module is imported only by who uses it, for it may need a library of its own."""
