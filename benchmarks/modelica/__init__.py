"""What a model costs: a sample of its blocks, and the generation of their library."""
