"""Messages to the mailboxes of slaves (ETG.1000.4), and their protocols: CoE, FoE and SoE."""
