"""The far end of the wire: simulated slaves and the echo, and the frames that are sent to them."""
