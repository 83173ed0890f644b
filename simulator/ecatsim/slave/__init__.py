"""One slave above its controller: state machine, mailbox protocols, dictionary, process data."""
