// What LeakSanitizer asks of the program, where AddressSanitizer is built into it.
#include <link.h>

#include <cstddef>
#include <cstring>

namespace {

int is_image_module(dl_phdr_info* library, std::size_t, void*) {
  return std::strstr(library->dlpi_name, "liblightkiln-image.so") != nullptr;
}

}  // namespace

/// Turns the search for leaks off in a process that has opened the image module: LeakSanitizer
/// crashes while it scans the thread-local storage of the 260 libraries behind it. The test
/// programs run the same code with leaks sought. The sanitizer's runtime asks for this by name at
/// exit.
extern "C" int __lsan_is_turned_off() {
  return dl_iterate_phdr(is_image_module, nullptr);
}
