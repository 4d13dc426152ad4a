// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

namespace envbake::test {

using Arguments = std::vector<std::string>;

inline Arguments operator+(Arguments a, const Arguments& b) {
    a.insert(a.end(), b.begin(), b.end());
    return a;
}

struct Outcome {
    int status = -1;  ///< exit status, or 128 + the signal that ended it
    std::string out, err;
    long peak_kilobytes = 0;  ///< resident

    long err_lines() const { return std::count(err.begin(), err.end(), '\n'); }
};

/// A program that runs beside the test, found in the test's own folder.
class Program {
  public:
    Program(const std::string& name, std::vector<std::string> arguments) {
        const auto folder = std::filesystem::read_symlink("/proc/self/exe").parent_path();
        arguments.insert(arguments.begin(), (folder / name).string());
        std::vector<char*> argv;
        for (std::string& argument : arguments) argv.push_back(argument.data());
        argv.push_back(nullptr);
        out_ = std::tmpfile();
        err_ = std::tmpfile();
        pid_ = ::fork();
        if (pid_ == 0) {
            ::dup2(::fileno(out_), STDOUT_FILENO);
            ::dup2(::fileno(err_), STDERR_FILENO);
            ::execv(argv[0], argv.data());
            ::_exit(127);
        }
    }

    void signal(int number) const { ::kill(pid_, number); }

    Outcome wait() {
        Outcome outcome;
        int status = 0;
        rusage usage{};
        ::wait4(pid_, &status, 0, &usage);
        outcome.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
        outcome.peak_kilobytes = usage.ru_maxrss;
        outcome.out = text(out_);
        outcome.err = text(err_);
        return outcome;
    }

  private:
    static std::string text(FILE* file) {
        std::string content;
        std::rewind(file);
        for (int c = std::fgetc(file); c != EOF; c = std::fgetc(file))
            content += static_cast<char>(c);
        std::fclose(file);
        return content;
    }

    FILE* out_ = nullptr;
    FILE* err_ = nullptr;
    pid_t pid_ = -1;
};

inline Outcome envbake(std::vector<std::string> arguments) {
    return Program("envbake", std::move(arguments)).wait();
}

}  // namespace envbake::test
