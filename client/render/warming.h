#pragma once
// Compiles what draws a world before it is needed, in a context of its own.

#include "common/wire/messages.h"

namespace ridgecast::render {

// Draws the world once with every pass, very small, in the current context, and forgets it. What remains is in the driver's cache on disk:
// other contexts of this machine then compile the same text in a part of the time. Without that cache nothing is gained. For worlds of
// which compilesText() holds; errors are left to whoever draws.
void warm(const wire::World& world);

}  // namespace ridgecast::render
