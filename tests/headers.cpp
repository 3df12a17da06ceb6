// The unit with which headers.h is precompiled.
