"""The cyclic exchange as the control side sees it: process image, shared memory, engine."""
