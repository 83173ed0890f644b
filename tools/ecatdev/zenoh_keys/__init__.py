"""The Zenoh keys of a bus with the types of all maps: docs/zenoh-keys.md, and a check of real maps.

The maps are the answers in `ecatd.operations`, and the classes of the bus description. The
annotations of a class are the keys of a map, and the docstring says what they mean. A key that is a
word of Python has a `_` behind it. Each map also has `schema`, which is left out here.
"""
