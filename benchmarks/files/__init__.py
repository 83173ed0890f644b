"""Files over FoE: how fast the daemon transfers one beside the cycle, and how fast SOEM does."""
