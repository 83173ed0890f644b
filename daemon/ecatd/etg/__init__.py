"""What the standards say: states, registers, types, EEPROMs, PDOs, mailbox protocols."""
