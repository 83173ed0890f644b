"""Reading the shared memory of a bus without asking anybody.

`reader` opens it and copies checked tables out of it, `contents` makes a document of everything in
it, `claims` one of who owns which outputs, `raw` one of a single table. The bus server writes it:
`master/engine/shared_memory.py`.
"""
