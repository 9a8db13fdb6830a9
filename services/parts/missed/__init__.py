"""What a recorder has missed: kept by those who publish it, and asked for by the next recorder."""
