#pragma once

#include <functional>

namespace CLI {
class App;
}

/// There is one function per command. It adds the command with its flags and help to the program,
/// and sets `run` to the command's work when the command line asks for it. `run` returns the
/// process's exit code.
namespace kiln::cli {

using Run = std::function<int()>;

void add_serve(CLI::App&, Run&);
void add_bake(CLI::App&, Run&);
void add_submit(CLI::App&, Run&);
void add_status(CLI::App&, Run&);
void add_watch(CLI::App&, Run&);
void add_cancel(CLI::App&, Run&);
void add_retry(CLI::App&, Run&);
void add_fetch(CLI::App&, Run&);
void add_compare(CLI::App&, Run&);
void add_view(CLI::App&, Run&);
void add_visibility(CLI::App&, Run&);
void add_scene(CLI::App&, Run&);
void add_settings(CLI::App&, Run&);
void add_token(CLI::App&, Run&);
void add_doctor(CLI::App&, Run&);
void add_version(CLI::App&, Run&);
void add_import_stage(CLI::App&, Run&);  ///< hidden: the other commands start it to read scenes

/// Parses the command line, runs the command and returns the exit code.
int run_program(int argc, char** argv);

}  // namespace kiln::cli
