#include "tests/bench/bench_process.h"

#include <errno.h>

#include <cstdio>
#include <cstdlib>

namespace rotunda::bench {

void Die(const std::string& what) {
  std::fprintf(stderr, "%s: %s\n", program_invocation_short_name, what.c_str());
  std::exit(1);
}

void OrDie(const Status& status) {
  if (!status.ok()) Die(status.error().ToString());
}

test::ProcessOutcome RunOrDie(const std::vector<std::string>& arguments) {
  std::fprintf(stderr, "running %s %s ...\n", arguments[0].c_str(), arguments[1].c_str());
  test::ProcessOutcome outcome = test::RunProcess(arguments);
  if (outcome.exit_code != 0) {
    Die(arguments[0] + " " + arguments[1] + " ended with " + std::to_string(outcome.exit_code) +
        "\n" + outcome.output + outcome.errors);
  }
  return outcome;
}

}  // namespace rotunda::bench
