"""The cyclic engine on two processors, as many as small industrial PCs have."""
