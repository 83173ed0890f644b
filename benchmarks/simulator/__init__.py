"""The speed of ecatsim, compared with a bare echo in C."""
