// SPDX-License-Identifier: Apache-2.0
#include "baker/input/image_worker.h"

#include "baker/core/parallel.h"
#include "baker/input/image_worker/protocol.h"
#include "baker/input/worker_reply.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <mutex>
#include <system_error>
#include <utility>
#include <vector>

extern char** environ;

namespace envbake {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr const char* kProgram = "envbake-image-worker";

std::string system_message(int code) {
    return std::generic_category().message(code);
}

/// An open file descriptor.
class File {
  public:
    File() = default;
    explicit File(int descriptor) : descriptor_(descriptor) {}
    File(File&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}
    File& operator=(File&& other) noexcept {
        std::swap(descriptor_, other.descriptor_);
        return *this;
    }
    ~File() {
        if (descriptor_ >= 0) close(descriptor_);
    }
    explicit operator bool() const { return descriptor_ >= 0; }
    int get() const { return descriptor_; }

  private:
    int descriptor_ = -1;
};

Error failed(std::string message) {
    return {Errc::Failed, std::move(message)};
}

Expected<fs::path> find_worker() {
    std::error_code error;
    const fs::path self = fs::read_symlink("/proc/self/exe", error);
    if (error) return failed(concat("/proc/self/exe: ", error.message()));
    const fs::path folder = self.parent_path();
    const fs::path beside = folder / kProgram;
    const fs::path installed = folder.parent_path() / "libexec" / "envbake" / kProgram;
    for (const fs::path& candidate : {beside, installed})
        if (access(candidate.c_str(), X_OK) == 0) return candidate;
    return failed(concat(kProgram, " is missing: neither ", beside.string(), " nor ",
                         installed.string(), " can be run"));
}

/// The worker process as the baker sees it. Not safe for threads: the Connection below is.
class Worker {
  public:
    Worker() = default;
    Worker(const Worker&) = delete;
    Worker& operator=(const Worker&) = delete;
    ~Worker() { stop(); }

    bool running() const { return static_cast<bool>(socket_); }

    Expected<void> start() {
        ENVBAKE_TRY(const fs::path program, find_worker());
        int ends[2];
        if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0) {
            return failed(concat(kProgram, ": no socket for it: ", system_message(errno)));
        }
        File ours(ends[0]);
        // Clear of the descriptors that the file actions are going to overwrite.
        const File low(ends[1]);
        const File theirs(fcntl(low.get(), F_DUPFD_CLOEXEC, worker::kSocket + 1));
        if (!theirs) return failed(concat(kProgram, ": no socket for it: ", system_message(errno)));

        // posix_spawn, and not fork: the baker has threads. Nothing the worker prints is for users:
        // what they need to know comes back as a reply.
        posix_spawn_file_actions_t actions;
        posix_spawn_file_actions_init(&actions);
        for (int standard = 0; standard < 3; ++standard)
            posix_spawn_file_actions_addopen(&actions, standard, "/dev/null", O_RDWR, 0);
        posix_spawn_file_actions_adddup2(&actions, theirs.get(), worker::kSocket);

        posix_spawnattr_t attributes;
        posix_spawnattr_init(&attributes);
        sigset_t none, defaults;
        sigemptyset(&none);
        sigemptyset(&defaults);
        for (const int signal : {SIGPIPE, SIGALRM, SIGCHLD}) sigaddset(&defaults, signal);
        posix_spawnattr_setsigmask(&attributes, &none);
        posix_spawnattr_setsigdefault(&attributes, &defaults);
        posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);

        // Libraries behind OpenImageIO would start thread pools that nobody uses.
        std::string settings[] = {"OPENBLAS_NUM_THREADS=1", "OMP_NUM_THREADS=1"};
        std::vector<char*> environment;
        for (std::string& setting : settings) environment.push_back(setting.data());
        for (char** variable = environ; *variable; ++variable) environment.push_back(*variable);
        environment.push_back(nullptr);

        std::string path = program.string();
        char* arguments[] = {path.data(), nullptr};
        const int error = posix_spawn(&process_, path.c_str(), &actions, &attributes, arguments,
                                      environment.data());
        posix_spawnattr_destroy(&attributes);
        posix_spawn_file_actions_destroy(&actions);
        if (error != 0) return failed(concat(path, ": cannot be started: ", system_message(error)));
        socket_ = std::move(ours);
        return {};
    }

    /// Ends the process, whatever it is doing.
    void stop() {
        if (!running()) return;
        kill(process_, SIGKILL);
        int status = 0;
        while (waitpid(process_, &status, 0) < 0 && errno == EINTR) {
        }
        socket_ = File();
    }

    bool send(const worker::Request& request, int input, int output) {
        const int files[2] = {input, output};
        iovec data{const_cast<worker::Request*>(&request), sizeof request};
        alignas(cmsghdr) char control[CMSG_SPACE(sizeof files)] = {};
        msghdr message{};
        message.msg_iov = &data;
        message.msg_iovlen = 1;
        message.msg_control = control;
        message.msg_controllen = sizeof control;
        cmsghdr* const header = CMSG_FIRSTHDR(&message);
        header->cmsg_level = SOL_SOCKET;
        header->cmsg_type = SCM_RIGHTS;
        header->cmsg_len = CMSG_LEN(sizeof files);
        std::memcpy(CMSG_DATA(header), files, sizeof files);
        ssize_t size;
        do {
            size = sendmsg(socket_.get(), &message, MSG_NOSIGNAL);
        } while (size < 0 && errno == EINTR);
        return size == sizeof request;
    }

    enum class Received { Reply, Late, Nothing };

    Received receive(worker::Reply& reply, Clock::duration patience) {
        const Clock::time_point deadline = Clock::now() + patience;
        for (;;) {
            const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
            pollfd wanted{socket_.get(), POLLIN, 0};
            const int ready = poll(&wanted, 1, std::max(0, static_cast<int>(left.count())));
            if (ready < 0 && errno == EINTR) continue;
            if (ready == 0) return Received::Late;
            const ssize_t size = recv(socket_.get(), &reply, sizeof reply, 0);
            if (size < 0 && errno == EINTR) continue;
            const bool whole = size == sizeof reply && reply.magic == worker::kMagic;
            return whole ? Received::Reply : Received::Nothing;
        }
    }

  private:
    pid_t process_ = -1;
    File socket_;
};

struct Connection {
    std::mutex mutex;
    Worker worker;
};

Connection& connection() {
    static Connection instance;
    return instance;
}

/// One request and its reply. A worker that has died between two requests is started again, once.
Expected<worker::Reply> ask(worker::Request request, int input, int output, double seconds) {
    // What starting up, and a machine that is busy, may add to the time that the worker keeps
    // itself.
    constexpr auto kGrace = std::chrono::seconds(30);
    constexpr double kMostSeconds = 24 * 3600;
    const double milliseconds = std::ceil(1e3 * std::min(seconds, kMostSeconds));
    request.milliseconds = static_cast<std::int32_t>(milliseconds);
    request.threads = thread_count();

    Connection& shared = connection();
    const std::lock_guard lock(shared.mutex);
    for (int attempt = 0; attempt < 2; ++attempt) {
        if (!shared.worker.running()) ENVBAKE_TRY_VOID(shared.worker.start());
        worker::Reply reply;
        Worker::Received received = Worker::Received::Nothing;
        if (shared.worker.send(request, input, output)) {
            received = shared.worker.receive(
                reply, std::chrono::milliseconds(request.milliseconds) + kGrace);
        }
        if (received == Worker::Received::Reply && reply.outcome == worker::Outcome::Unable) {
            return failed(concat(kProgram, ": ", complaint(reply, seconds)));
        }
        if (received == Worker::Received::Reply) return reply;
        shared.worker.stop();
        if (received == Worker::Received::Late) {
            reply = {};
            reply.outcome = worker::Outcome::TimedOut;
            return reply;
        }
    }
    return failed(concat(kProgram, " ends at once: run it by hand to see which library it lacks"));
}

Error not_an_image(const std::string& name, const std::string& why) {
    return {Errc::InvalidInput, concat(name, ": not a readable image (", why, ")")};
}

/// A nameless file in memory.
File memory_file() {
    return File(memfd_create("envbake", MFD_CLOEXEC | MFD_ALLOW_SEALING));
}

bool write_all(int file, std::span<const std::byte> bytes) {
    while (!bytes.empty()) {
        const ssize_t n = write(file, bytes.data(), bytes.size());
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        bytes = bytes.subspan(static_cast<std::size_t>(n));
    }
    return true;
}

Expected<File> open_input(const fs::path& file) {
    // A pipe would block open(); it is refused below, for its content is needed more than once.
    File input(open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    if (!input) return failed(concat(file.string(), ": cannot be opened: ", system_message(errno)));
    struct stat info {};
    if (fstat(input.get(), &info) != 0 || !S_ISREG(info.st_mode)) {
        return failed(concat(file.string(), ": not a regular file"));
    }
    return input;
}

/// Opens a new file beside `target`, under a name that nobody else uses.
File open_temporary(const fs::path& target, fs::path& temporary) {
    for (int i = 0; i < 1000; ++i) {
        temporary = target;
        temporary += concat(".", getpid(), "-", i, ".tmp");
        const int file = open(temporary.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (file >= 0 || errno != EEXIST) return File(file);
    }
    return File();
}

Expected<void> encode(const worker::Request& request, const fs::path& target,
                      std::span<const std::byte> pixels) {
    const auto cannot = [&](const std::string& why) {
        return failed(concat(target.string(), ": cannot be written: ", why));
    };
    const File input = memory_file();
    if (!input || !write_all(input.get(), pixels)) return cannot(system_message(errno));
    fs::path temporary;
    const File output = open_temporary(target, temporary);
    if (!output) return cannot(system_message(errno));

    const ImageLimits limits{.seconds = 600};
    const auto reply = ask(request, input.get(), output.get(), limits.seconds);
    std::string why = reply ? complaint(*reply, limits.seconds) : std::string();
    if (reply && why.empty()) {
        if (fsync(output.get()) == 0 && rename(temporary.c_str(), target.c_str()) == 0) return {};
        why = system_message(errno);
    }
    unlink(temporary.c_str());
    if (!reply) return reply.error();
    return cannot(why);
}

}  // namespace

SharedPixels::SharedPixels(SharedPixels&& other) noexcept
    : begin_(std::exchange(other.begin_, nullptr)),
      size_(std::exchange(other.size_, 0)),
      released_(std::exchange(other.released_, 0)) {}

SharedPixels& SharedPixels::operator=(SharedPixels&& other) noexcept {
    std::swap(begin_, other.begin_);
    std::swap(size_, other.size_);
    std::swap(released_, other.released_);
    return *this;
}

SharedPixels::~SharedPixels() {
    if (begin_) munmap(begin_, size_);
}

void SharedPixels::release_front(std::size_t size) {
    const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
    const std::size_t end = std::min(size, size_) / page * page;
    if (end <= released_) return;
    // MADV_REMOVE frees the memory file itself. Where it cannot, memory is freed a little later.
    madvise(begin_ + released_, end - released_, MADV_REMOVE);
    released_ = end;
}

std::span<const float> FloatImage::row(int y) const {
    assert(y >= 0 && y < height);
    const std::size_t row_floats = 3 * static_cast<std::size_t>(width);
    const auto* const first = reinterpret_cast<const float*>(pixels.bytes().data());
    return {first + row_floats * static_cast<std::size_t>(y), row_floats};
}

void FloatImage::release_rows_before(int y) {
    pixels.release_front(3 * sizeof(float) * static_cast<std::size_t>(width) *
                         static_cast<std::size_t>(y));
}

Expected<FloatImage> decode_float_image(const fs::path& file, const ImageLimits& limits) {
    const std::string name = file.string();
    ENVBAKE_TRY(const File input, open_input(file));
    const File output = memory_file();
    if (!output) return failed(concat(name, ": no memory for its pixels: ", system_message(errno)));
    ENVBAKE_TRY(const worker::Reply reply, ask({.task = worker::Task::DecodeFloat}, input.get(),
                                               output.get(), limits.seconds));
    if (const std::string why = complaint(reply, limits.seconds); !why.empty()) {
        return not_an_image(name, why);
    }
    FloatImage image;
    ENVBAKE_TRY(image.pixels, map_pixels(reply, 3 * sizeof(float), output.get(), name));
    image.width = reply.width;
    image.height = reply.height;
    switch (reply.projection) {
        case worker::Projection::EnvmapLatLong:
            image.envmap = Envmap::LatLong;
            break;
        case worker::Projection::EnvmapCube:
            image.envmap = Envmap::Cube;
            break;
        case worker::Projection::Plain:
            break;
    }
    const auto window = [](const std::array<std::int32_t, 4>& w) {
        return TexelWindow{w[0], w[1], w[2], w[3]};
    };
    image.data_window = window(reply.data_window);
    image.display_window = window(reply.display_window);
    if (reply.has_chromaticities != 0) image.chromaticities = reply.chromaticities;
    return image;
}

Expected<Image> decode_image(std::span<const std::byte> encoded, const std::string& name,
                             const ImageLimits& limits) {
    const File input = memory_file();
    const File output = memory_file();
    if (!input || !output || !write_all(input.get(), encoded)) {
        return failed(concat(name, ": no memory for it: ", system_message(errno)));
    }
    ENVBAKE_TRY(const worker::Reply reply, ask({.task = worker::Task::DecodeRgba8}, input.get(),
                                               output.get(), limits.seconds));
    if (const std::string why = complaint(reply, limits.seconds); !why.empty()) {
        return not_an_image(name, why);
    }
    ENVBAKE_TRY(const SharedPixels pixels, map_pixels(reply, 4, output.get(), name));
    Image image;
    image.name = name;
    image.width = reply.width;
    image.height = reply.height;
    const auto* const first = reinterpret_cast<const std::uint8_t*>(pixels.bytes().data());
    image.rgba.assign(first, first + pixels.bytes().size());
    return image;
}

Expected<SharedPixels> decode_draco_stream(std::span<const std::byte> stream) {
    const std::string name = "the Draco stream";
    const File input = memory_file();
    const File output = memory_file();
    if (!input || !output || !write_all(input.get(), stream))
        return failed(concat(name, ": no memory for it: ", system_message(errno)));
    // Decoders do some 10 MB a second.
    const double seconds = 60 + 1e-6 * static_cast<double>(stream.size());
    ENVBAKE_TRY(const worker::Reply reply,
                ask({.task = worker::Task::DecodeDraco}, input.get(), output.get(), seconds));
    if (const std::string why = complaint(reply, seconds); !why.empty())
        return Error{Errc::InvalidInput, concat(name, " cannot be decoded (", why, ")")};
    return map_output(output.get(), worker::most_draco_bytes(stream.size()), name);
}

Expected<void> write_png(const fs::path& file, int width, int height,
                         std::span<const std::uint8_t> rgb) {
    return encode({.task = worker::Task::EncodePng, .width = width, .height = height}, file,
                  std::as_bytes(rgb));
}

Expected<void> write_gif(const fs::path& file, int width, int height, int frames,
                         int frames_per_second, std::span<const std::uint8_t> rgb) {
    return encode({.task = worker::Task::EncodeGif,
                   .width = width,
                   .height = height,
                   .frames = frames,
                   .frames_per_second = frames_per_second},
                  file, std::as_bytes(rgb));
}

Expected<void> write_exr(const fs::path& file, int width, int height, std::span<const float> rgb) {
    return encode({.task = worker::Task::EncodeExr, .width = width, .height = height}, file,
                  std::as_bytes(rgb));
}

void start_image_worker() {
    Connection& shared = connection();
    const std::lock_guard lock(shared.mutex);
    // A failure comes back, with its reason, from the first call that needs the worker.
    if (!shared.worker.running()) (void)shared.worker.start();
}

}  // namespace envbake
