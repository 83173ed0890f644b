"""Network interfaces of Linux: virtual Ethernet pairs, links and carriers."""
