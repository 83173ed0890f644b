"""What the cyclic engine does on two processors, as many as small industrial PCs have."""
