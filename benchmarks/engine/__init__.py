"""The speed of the cyclic engine beside other masters, and beside loads."""
