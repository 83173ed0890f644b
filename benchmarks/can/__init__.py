"""CAN buses behind terminals."""
