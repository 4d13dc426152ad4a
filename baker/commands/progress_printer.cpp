// SPDX-License-Identifier: Apache-2.0
#include "baker/commands/progress_printer.h"

#include "baker/core/error.h"
#include "baker/core/text.h"

#include <unistd.h>

#include <algorithm>
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
    State(const Progress& p, std::ostream& e, ProgressStyle s)
        : progress(p), err(e), json(s == ProgressStyle::Json) {
        thread = std::thread([this] { watch(); });
    }
    ~State() {
        {
            const std::lock_guard lock(mutex);
            stop = true;
        }
        wake.notify_all();
        thread.join();
        if (json) print();
        if (terminal && printed) err << "\r\x1b[K" << std::flush;
    }

    void watch() {
        std::unique_lock lock(mutex);
        const auto interval = json       ? std::chrono::milliseconds(500)
                              : terminal ? std::chrono::milliseconds(250)
                                         : std::chrono::seconds(10);
        while (!wake.wait_for(lock, interval, [this] { return stop; })) print();
    }

    void print() {
        const char* what = progress.what();
        const std::uint64_t total = progress.total(), done = progress.done();
        if (total == 0) return;
        const double seconds =
            std::chrono::duration<double>(Clock::now() - progress.begun()).count();
        const double rate = seconds > 0 ? static_cast<double>(done) / seconds : 0;
        if (json) {
            err << "{\"stage\":\"" << what << "\",\"done\":" << done << ",\"total\":" << total
                << ",\"unit\":\"" << progress.unit() << "\",\"rays\":" << progress.rays()
                << ",\"error\":";
            if (const auto error = progress.error())
                err << *error;
            else
                err << "null";
            err << ",\"seconds\":" << seconds << ",\"seconds_left\":";
            if (rate > 0)
                err << static_cast<double>(total - std::min(done, total)) / rate;
            else
                err << "null";
            err << '}' << std::endl;
            return;
        }
        const double fraction = static_cast<double>(done) / static_cast<double>(total);
        const std::string left =
            rate > 0 ? time_left(static_cast<double>(total - done) / rate) : "";
        const std::string rays =
            progress.rays() > 0 ? concat(", ", format_count(progress.rays()), " rays") : "";
        const auto now = progress.error();
        const std::string error = now ? concat(", error ", format_number(*now)) : "";
        const std::string line =
            concat(what, ": ", static_cast<int>(100 * fraction), " %, ", format_count(done), " of ",
                   format_count(total), " ", progress.unit(), rays, error, left);
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
    const bool json;
    const bool terminal = !json && ::isatty(STDERR_FILENO) == 1;
    bool printed = false;
    bool stop = false;
    std::mutex mutex;
    std::condition_variable wake;
    std::thread thread;
};

ProgressPrinter::ProgressPrinter(const Progress& progress, std::ostream& err, ProgressStyle style)
    : state_(std::make_unique<State>(progress, err, style)) {}
ProgressPrinter::~ProgressPrinter() = default;

}  // namespace envbake
