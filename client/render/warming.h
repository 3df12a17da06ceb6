#pragma once
// Compiles what draws a world before it is needed, in a context of its own.

#include "common/wire/messages.h"

namespace ridgecast::render {

// Draws the world once with every pass, very small, in the current context, and discards it. That fills the driver's cache on disk: other
// contexts of this machine then compile the same text in a fraction of the time. Without that cache nothing is gained. For worlds where
// compilesText() holds; errors are left to later drawing.
void warm(const wire::World& world);

}  // namespace ridgecast::render
