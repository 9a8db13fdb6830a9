"""Sockets: addresses, a reactor, the wire format, TCP and UDP transports."""
