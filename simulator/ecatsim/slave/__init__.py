"""A slave without its controller: state machine, mailbox protocols, dictionary, process data."""
