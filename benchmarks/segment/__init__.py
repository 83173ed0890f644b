"""What answers: simulated slaves, the echo, and the frames that are sent to them."""
