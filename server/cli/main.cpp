#include "baker/image/image.h"
#include "server/cli/commands.h"

int main(int argc, char** argv) {
  kiln::image::ignore_environment();
  return kiln::cli::run_program(argc, argv);
}
