"""Files over FoE: the speed of the daemon while it exchanges process data, and of SOEM."""
