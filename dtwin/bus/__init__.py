"""The bus that joins the services: messages, their bytes, and the only room that knows Zenoh."""
