"""Device management: requests and answers, client and server, boot files."""
