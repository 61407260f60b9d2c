"""Machine code: compilation by LLVM and the object cache on disk."""
