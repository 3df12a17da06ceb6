#pragma once
// RIDGECAST_VECTOR_CLONES before a function: it is compiled for several instruction sets, chosen when the program starts. Nothing is
// contracted, so the results are the same in each.

#if defined(__x86_64__) && !defined(RIDGECAST_SANITIZED)
#define RIDGECAST_VECTOR_CLONES __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define RIDGECAST_VECTOR_CLONES
#endif
