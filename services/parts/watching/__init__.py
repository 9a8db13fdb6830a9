"""What services that watch an arm share: who asks, starts and stops the monitor, and who hears of what it notices."""
