"""The installation of the service, and the doctor of a machine."""
