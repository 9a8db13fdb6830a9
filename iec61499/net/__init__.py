"""Sockets: addresses, a reactor, the wire format, streams and UDP."""
