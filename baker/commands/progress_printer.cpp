// SPDX-License-Identifier: Apache-2.0
#include "baker/commands/progress_printer.h"

#include "baker/core/error.h"
#include "baker/core/text.h"

#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <ostream>
#include <string>
#include <thread>

namespace envbake {

namespace {

using Clock = std::chrono::steady_clock;

std::string time_left(double seconds) {
    if (seconds < 1) return "";
    const auto whole = static_cast<long>(seconds + 0.5);
    return concat(", ", whole / 60, whole % 60 < 10 ? ":0" : ":", whole % 60, " left");
}

}  // namespace

struct ProgressPrinter::State {
    State(const Progress& p, std::ostream& e) : progress(p), err(e) {
        thread = std::thread([this] { watch(); });
    }
    ~State() {
        {
            const std::lock_guard lock(mutex);
            stop = true;
        }
        wake.notify_all();
        thread.join();
        if (terminal && printed) err << "\r\x1b[K" << std::flush;
    }

    void watch() {
        std::unique_lock lock(mutex);
        const auto interval = terminal ? std::chrono::milliseconds(250) : std::chrono::seconds(10);
        while (!wake.wait_for(lock, interval, [this] { return stop; })) print();
    }

    void print() {
        const char* what = progress.what();
        const std::uint64_t total = progress.total(), done = progress.done();
        if (what != last_what) {
            last_what = what;
            begun = Clock::now();
        }
        if (total == 0) return;
        const double seconds = std::chrono::duration<double>(Clock::now() - begun).count();
        const double rate = seconds > 0 ? static_cast<double>(done) / seconds : 0;
        const double fraction = static_cast<double>(done) / static_cast<double>(total);
        const std::string left =
            rate > 0 ? time_left(static_cast<double>(total - done) / rate) : "";
        const std::string line =
            concat(what, ": ", static_cast<int>(100 * fraction), " %, ", format_count(done), " of ",
                   format_count(total), " ", progress.unit(), left);
        if (terminal) {
            constexpr int kBarSize = 24;
            std::string bar(static_cast<std::size_t>(fraction * kBarSize), '#');
            bar.resize(kBarSize, '.');
            err << "\r\x1b[K[" << bar << "] " << line << std::flush;
        } else {
            err << "envbake: " << line << std::endl;
        }
        printed = true;
    }

    const Progress& progress;
    std::ostream& err;
    const bool terminal = ::isatty(STDERR_FILENO) == 1;
    bool printed = false;
    bool stop = false;
    const char* last_what = nullptr;
    Clock::time_point begun = Clock::now();
    std::mutex mutex;
    std::condition_variable wake;
    std::thread thread;
};

ProgressPrinter::ProgressPrinter(const Progress& progress, std::ostream& err)
    : state_(std::make_unique<State>(progress, err)) {}
ProgressPrinter::~ProgressPrinter() = default;

}  // namespace envbake
