"""ecatctl: the command line, over the gateway."""
