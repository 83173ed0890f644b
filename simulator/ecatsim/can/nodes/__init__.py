"""CAN nodes that come with ecatsim."""
