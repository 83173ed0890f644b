"""The gateway: the unprivileged process that speaks Zenoh."""
