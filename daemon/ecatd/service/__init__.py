"""ecatd, the service: starts and supervises the bus server and the gateway."""
