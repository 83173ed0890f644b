"""Pages of the live view beside the exchange, and what each part of them needs of a core."""
