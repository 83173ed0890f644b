"""The cost of a model: a sample through its blocks, and the generation of its library."""
