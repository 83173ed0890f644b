"""The Zenoh keys of a bus with the types of all maps: docs/zenoh-keys.md, and a check of real maps.

The annotations of a class are the keys of a map, and the docstring says what they mean. A key that
is a word of Python has a `_` behind it. Each map also has `schema`, which is left out here. Maps of
the bus description are the classes of `ecatd.model` themselves.
"""
