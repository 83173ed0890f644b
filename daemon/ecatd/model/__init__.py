"""Data and file formats that all parts share; nothing here imports another part."""
