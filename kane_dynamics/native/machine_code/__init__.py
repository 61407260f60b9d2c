"""Machine code: assembled by LLVM, kept in a cache on disk."""
