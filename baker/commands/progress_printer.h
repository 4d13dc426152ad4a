// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/progress.h"

#include <iosfwd>
#include <memory>

namespace envbake {

enum class ProgressStyle {
    Text,
    Json,  ///< one object a line, docs/cli.md; twice a second and at the end, terminal or not
};

/// Watches a Progress while it lives and prints to `err`: on a terminal a bar with rate and time
/// left, four times a second; elsewhere a line every ten seconds.
class ProgressPrinter {
  public:
    ProgressPrinter(const Progress& progress, std::ostream& err,
                    ProgressStyle style = ProgressStyle::Text);
    ~ProgressPrinter();

  private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace envbake
