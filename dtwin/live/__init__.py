"""The running cell's own bookkeeping: which commands count, how late they are, what to replay, what makes a row."""
