"""SDO reads over Zenoh: how many per second, how long one takes, and how long one command takes."""
