"""What people look at, in the browser and in a terminal."""
