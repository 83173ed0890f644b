"""The bus server: the privileged process that owns the bus."""
