"""The server of `ecatctl web`: a page in the browser that shows a bus, or a recording.

One process, apart from the daemon and with none of its rights: it is a client of the gateway like
any other. `server.py` serves the page and its WebSocket, `guard.py` says who may open it, `page.py`
is one page that is open, and `hub.py` what all of them are told. What they are told comes from
`bus.py` (a daemon) or from `recording.py` (a file).
"""
