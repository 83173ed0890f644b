"""Pure data that every part shares: no input or output, no import of other parts."""
