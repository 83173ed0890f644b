"""The command `ecatctl`: asks the gateway, or reads the shared memory of this machine."""
