"""Data and file formats that all parts share. This package imports no other part."""
