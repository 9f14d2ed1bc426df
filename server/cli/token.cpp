#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "server/auth/token_store.h"
#include "server/cli/commands.h"
#include "server/cli/config.h"
#include "server/cli/report.h"
#include "server/data/data_folder.h"

namespace kiln::cli {
namespace {

struct TokenFlags {
  std::string data, tenant, id;
  std::vector<std::string> scopes{"read", "write"};
  std::uint32_t days = 0;
};

using Work = std::function<int(auth::TokenStore&, const TokenFlags&)>;

// Opens the token store in the service's data folder, which it finds by the service's own rules.
// The service may run meanwhile.
int with_store(const TokenFlags& flags, const Work& work) {
  ConfigSources sources;
  if (!flags.data.empty()) sources.flags["data"] = flags.data;
  sources.environment = process_environment();
  const auto loaded = load_config(sources);
  if (!loaded) return report(loaded.error());
  const auto& data = loaded->config.data;
  std::error_code error;
  std::filesystem::create_directories(data, error);
  if (error)
    return report({"io_error",
                   "The folder " + data.string() + " can't be made: " + error.message() + ".",
                   {}});
  try {
    auth::TokenStore store(data::DataFolder::tokens_of(data));
    return work(store, flags);
  } catch (const store::DatabaseError& e) {
    return report({"io_error", e.what(), {}});
  }
}

int create(auth::TokenStore& store, const TokenFlags& flags) {
  constexpr std::uint64_t kDay = 86'400;
  const auto made = store.create(flags.tenant, flags.scopes, flags.days * kDay);
  if (!made) return report(made.error());
  std::fprintf(stderr, "%s: keep the secret below; it is shown only once\n",
               made->token.id.c_str());
  std::puts(made->secret.c_str());
  return kDone;
}

int list(auth::TokenStore& store, const TokenFlags&) {
  for (const auto& token : store.list()) {
    std::string scopes;
    for (const auto& scope : token.scopes) scopes += (scopes.empty() ? "" : ",") + scope;
    const std::string end = !token.revoked_at.empty()   ? "revoked " + token.revoked_at
                            : !token.expires_at.empty() ? "expires " + token.expires_at
                                                        : "valid";
    std::printf("%s  %-20s  %-16s  %s  %s\n", token.id.c_str(), token.tenant.c_str(),
                scopes.c_str(), token.created_at.c_str(), end.c_str());
  }
  return kDone;
}

int revoke(auth::TokenStore& store, const TokenFlags& flags) {
  const auto done = store.revoke(flags.id);
  return done ? int{kDone} : report(done.error());
}

CLI::App* add_action(CLI::App& token, const char* name, const char* help,
                     const std::shared_ptr<TokenFlags>& flags, Run& run, const Work& work) {
  auto* action = token.add_subcommand(name, help);
  action->add_option("--data", flags->data, "The service's data folder [that of `serve`]")
      ->type_name("DIR");
  action->callback(
      [flags, work, &run] { run = [flags, work] { return with_store(*flags, work); }; });
  return action;
}

}  // namespace

void add_token(CLI::App& app, Run& run) {
  auto flags = std::make_shared<TokenFlags>();
  auto* token = app.add_subcommand("token", "Manage the tokens that give access to a service");
  token->require_subcommand(1);
  auto* made = add_action(*token, "create", "Make a token and print it", flags, run, create);
  made->add_option("--tenant", flags->tenant, "The tenant whose jobs the token makes and sees")
      ->required()
      ->type_name("NAME");
  made->add_option("--scope", flags->scopes,
                   "What the token allows: read, write, or admin (everything, for all tenants)\n"
                   "[read and write]")
      ->type_name("SCOPE")
      ->take_all();
  made->add_option("--expires-days", flags->days, "Days that it is valid; 0: until it is revoked")
      ->check(CLI::Range(0u, 36'500u))
      ->type_name("N")
      ->capture_default_str();
  add_action(*token, "list", "Show all tokens, without their secrets", flags, run, list);
  auto* revoked = add_action(*token, "revoke", "Make a token invalid", flags, run, revoke);
  revoked->add_option("id", flags->id, "The token's id: tok_...")->required()->type_name("ID");
  token->footer(
      R"text(The commands work on the service's data folder, whether the service runs or not. Changes hold from
the next request on. Once there is a token, every request needs one, and the service may listen on
other addresses than loopback.

Examples:
  lightkiln token create --tenant art > token
  curl -H "Authorization: Bearer $(cat token)" http://bake:8080/v1/jobs
  lightkiln submit room.glb --server http://bake:8080 --token-file token --wait -o out/
  lightkiln token create --tenant ops --scope admin --expires-days 30)text");
}

}  // namespace kiln::cli
