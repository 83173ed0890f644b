"""The speed of ecatsim beside a bare C echo."""
