"""Who uses a console: names and roles, sessions, who has the desk, and what they did."""
