"""The slaves as a whole: their AL states, their mailboxes, and the thread that waits for them."""
