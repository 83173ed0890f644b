"""What the kernel and systemd of this machine know and can do."""
