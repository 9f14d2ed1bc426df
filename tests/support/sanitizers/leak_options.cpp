/// Keeps LeakSanitizer from the program, where AddressSanitizer is built into it: it crashes while
/// it scans the thread-local storage of the 260 libraries behind the image module. Its runtime asks
/// for this by name. The test programs run the same code with leaks sought.
extern "C" const char* __lsan_default_options() {
  return "detect_leaks=0";
}
