"""The modes of the node: the law of each, its settings, and the targets that it follows."""
