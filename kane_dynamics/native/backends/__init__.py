"""Programs as LLVM text, scalar and in SIMD lanes, and as C99."""
