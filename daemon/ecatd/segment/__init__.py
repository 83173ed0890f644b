"""Reading the shared memory of a bus without asking anybody.

`reader` opens segments and copies checked tables out of them, `picture` makes a document of all
that is in them, `claims` one of who owns which outputs, `raw` one of a single table. The bus
server, which writes the segments, has its own side in `bus/segment.py`.
"""
