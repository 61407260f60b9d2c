"""The methods of `Robot`, by subject, and the dispatch to their compiled kernels."""
