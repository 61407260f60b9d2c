"""Back ends: generate LLVM IR (scalar and SIMD) and C99 from a traced program."""
