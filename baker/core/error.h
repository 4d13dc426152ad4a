// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/format/result.h"

#include <ostream>
#include <sstream>
#include <string>
#include <utility>

namespace envbake {

/// Why a command failed; each kind has its exit status (docs/cli.md).
enum class Errc {
    Failed,         ///< the work failed: I/O, memory                 exit 1
    Usage,          ///< the request makes no sense                   exit 2
    InvalidInput,   ///< an image or a scene is not acceptable        exit 3
    InvalidBundle,  ///< a bundle is damaged, foreign or too new      exit 4
};

/// One line for a person: the file, the thing in it, the value seen, the value accepted.
struct Error {
    Errc code = Errc::Failed;
    std::string message;

    friend std::ostream& operator<<(std::ostream& out, const Error& e) { return out << e.message; }
};

template <class T>
using Expected = Result<T, Error>;

/// Joins its arguments as operator<< prints them.
template <class... Args>
std::string concat(const Args&... args) {
    std::ostringstream out;
    (out << ... << args);
    return std::move(out).str();
}

}  // namespace envbake
