"""Files of vendors and of other tools: ESI (ETG.2000) and ENI (ETG.2100)."""
