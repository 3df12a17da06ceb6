#include "client/render/context.h"

#include <dlfcn.h>
#include <epoxy/egl.h>
#include <epoxy/gl.h>

#include <array>
#include <string_view>
#include <vector>

namespace ridgecast::render {
namespace {

bool libraryExists(const char* name) {
  // libepoxy aborts the program if it cannot load a library, so try first.
  void* library = dlopen(name, RTLD_LAZY | RTLD_LOCAL);
  if (library) dlclose(library);
  return library != nullptr;
}

bool contains(const char* list, std::string_view name) { return list && std::string_view(list).find(name) != std::string_view::npos; }

std::vector<EGLDisplay> displays() {
  std::vector<EGLDisplay> found;
  const char* extensions = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
  if (contains(extensions, "EGL_EXT_platform_base")) {
    if (contains(extensions, "EGL_EXT_device_enumeration") && contains(extensions, "EGL_EXT_platform_device")) {
      std::array<EGLDeviceEXT, 16> devices;
      EGLint count = 0;
      if (eglQueryDevicesEXT(devices.size(), devices.data(), &count))
        for (EGLint k = 0; k < count; ++k) found.push_back(eglGetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, devices[k], nullptr));
    }
    if (contains(extensions, "EGL_MESA_platform_surfaceless"))
      found.push_back(eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr));
  }
  found.push_back(eglGetDisplay(EGL_DEFAULT_DISPLAY));
  std::erase(found, EGL_NO_DISPLAY);
  return found;
}

EGLContext createContext(EGLDisplay display) {
  if (!contains(eglQueryString(display, EGL_EXTENSIONS), "EGL_KHR_surfaceless_context") || !eglBindAPI(EGL_OPENGL_API))
    return EGL_NO_CONTEXT;
  const std::array<EGLint, 5> wanted = {EGL_SURFACE_TYPE, EGL_PBUFFER_BIT, EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT, EGL_NONE};
  EGLConfig config = nullptr;
  EGLint count = 0;
  if (!eglChooseConfig(display, wanted.data(), &config, 1, &count) || count < 1) config = nullptr;
  for (const auto& [major, minor] : {std::pair{4, 5}, std::pair{3, 3}}) {
    const std::array<EGLint, 7> attributes = {
        EGL_CONTEXT_MAJOR_VERSION,           major,   EGL_CONTEXT_MINOR_VERSION, minor, EGL_CONTEXT_OPENGL_PROFILE_MASK,
        EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT, EGL_NONE};
    const EGLContext context = eglCreateContext(display, config, EGL_NO_CONTEXT, attributes.data());
    if (context != EGL_NO_CONTEXT) return context;
  }
  return EGL_NO_CONTEXT;
}

}  // namespace

Outcome<std::unique_ptr<HeadlessContext>> HeadlessContext::create() {
  if (!libraryExists("libEGL.so.1"))
    return Error{
        "drawing without a window needs EGL, but libEGL.so.1 is not installed: install libegl1 and a driver such as libgl1-mesa-dri"};
  bool anyDisplay = false;
  for (const EGLDisplay display : displays()) {
    if (!eglInitialize(display, nullptr, nullptr)) continue;
    anyDisplay = true;
    const EGLContext context = createContext(display);
    if (context != EGL_NO_CONTEXT) {
      if (eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context))
        return std::unique_ptr<HeadlessContext>(new HeadlessContext(display, context));
      eglDestroyContext(display, context);
    }
  }
  if (!anyDisplay)
    return Error{
        "no OpenGL: drawing without a window needs an EGL driver, but none could be started: install libegl-mesa0 and libgl1-mesa-dri"};
  return Error{
      "no EGL driver of this machine offers an OpenGL 3.3 core context without a window: install libgl1-mesa-dri or a newer graphics "
      "driver"};
}

HeadlessContext::~HeadlessContext() {
  eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  eglDestroyContext(display_, context_);
  // The display stays: it belongs to the process, and others may be drawing on it.
}

std::string contextDescription() {
  const auto* renderer = reinterpret_cast<const char*>(glGetString(GL_RENDERER));
  const int version = epoxy_gl_version();
  return std::string(renderer ? renderer : "unknown") + ", OpenGL " + std::to_string(version / 10) + "." + std::to_string(version % 10);
}

}  // namespace ridgecast::render
