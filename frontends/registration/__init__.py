"""Where exactly the clouds of two keyframes lie to each other, and how well that is known."""
