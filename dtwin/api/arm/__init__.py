"""What notebooks and scripts use for logs of arms of any number of joints: identification, monitoring, records."""
