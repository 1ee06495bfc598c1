"""Teaching the network that proposes landmarks: examples, what to answer, learning, weighing."""
