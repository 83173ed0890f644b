"""What a capture of a real segment (pcapng, pcap) says about its slaves, and a rig made of it."""
