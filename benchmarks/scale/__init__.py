"""How start, memory and work of the daemon grow with the number of slaves, up to a thousand."""
