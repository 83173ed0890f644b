"""The values of every cycle, out of the frames that carried them."""
