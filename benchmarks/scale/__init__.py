"""How the daemon grows with the slaves of a bus, up to a thousand."""
