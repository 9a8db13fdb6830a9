"""The arm as it is believed: what is known of it beforehand, how it moves, and the filter that learns it."""
