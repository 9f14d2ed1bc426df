#include "server/cli/commands.h"

int main(int argc, char** argv) {
  return kiln::cli::run_program(argc, argv);
}
