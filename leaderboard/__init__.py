"""The rows of the leaderboard, the cards of their methods, and published tables."""
