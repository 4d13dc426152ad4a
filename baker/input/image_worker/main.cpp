// SPDX-License-Identifier: Apache-2.0
// envbake-image-worker: decodes and encodes images, and decodes Draco meshes, where a crash harms
// nobody (protocol.h).

#include "baker/input/image_worker/codec.h"
#include "baker/input/image_worker/protocol.h"

#include <ImfThreading.h>

#include <dlfcn.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string>

namespace envbake::worker {

void forget(Bytes file) {
    // Nothing is lost: the mapping has never been written to.
    madvise(const_cast<std::byte*>(file.data()), file.size(), MADV_DONTNEED);
}

namespace {

/// What a decoder may use beside its output: buffers of a chunk for each thread, and the libraries'
/// bookkeeping.
constexpr rlim_t kWorkingBytes = rlim_t{2} << 30;
constexpr int kMaxThreads = 8;  // each takes address space for its stack and its arena

/// Address space in use, bytes.
rlim_t address_space() {
    unsigned long pages = 0;
    if (FILE* const file = std::fopen("/proc/self/statm", "re")) {
        if (std::fscanf(file, "%lu", &pages) != 1) pages = 0;
        std::fclose(file);
    }
    return rlim_t{pages} * static_cast<rlim_t>(sysconf(_SC_PAGESIZE));
}

/// Sanitizers have reserved terabytes of address space by now, and ask for more as others do.
void limit_memory(rlim_t output_bytes) {
    rlimit limit{};
    getrlimit(RLIMIT_AS, &limit);
    limit.rlim_cur = std::min(limit.rlim_max, address_space() + kWorkingBytes + output_bytes);
    setrlimit(RLIMIT_AS, &limit);
}

void limit_time(int milliseconds) {
    itimerval timer{};
    timer.it_value.tv_sec = milliseconds / 1000;
    timer.it_value.tv_usec = (milliseconds % 1000) * 1000;
    setitimer(ITIMER_REAL, &timer, nullptr);  // SIGALRM ends the process
}

/// The whole of a file, for as long as the process lives. Private: nobody sees what is written to
/// it.
Bytes map_input(int file) {
    struct stat info {};
    if (fstat(file, &info) != 0 || info.st_size < 0) throw Refusal("its size cannot be told");
    if (info.st_size == 0) return {};
    const auto size = static_cast<std::size_t>(info.st_size);
    void* const at = mmap(nullptr, size, PROT_READ, MAP_PRIVATE, file, 0);
    if (at == MAP_FAILED) throw Refusal("it cannot be mapped into memory");
    return {static_cast<const std::byte*>(at), size};
}

std::byte* map_output(int file, std::size_t size) {
    limit_memory(size);
    if (ftruncate(file, static_cast<off_t>(size)) != 0) throw std::bad_alloc();
    void* const at = mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (at == MAP_FAILED) throw std::bad_alloc();
    return static_cast<std::byte*>(at);
}

void write_all(int file, Bytes bytes) {
    for (std::size_t done = 0; done < bytes.size();) {
        const ssize_t n = write(file, bytes.data() + done, bytes.size() - done);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) throw Refusal(std::strerror(errno));
        done += static_cast<std::size_t>(n);
    }
}

/// Loaded by the worker itself, so that its children have it already.
const OiioCodecs* oiio = nullptr;

bool needs_oiio(Task task) {
    return task == Task::DecodeRgba8 || task == Task::EncodePng || task == Task::EncodeGif;
}

/// Throws what the dynamic linker says.
void load_oiio() {
    if (oiio) return;
    std::array<char, 4096> self{};
    const ssize_t size = readlink("/proc/self/exe", self.data(), self.size());
    if (size <= 0 || size == static_cast<ssize_t>(self.size()))
        throw std::runtime_error("no /proc");
    std::string path(self.data(), static_cast<std::size_t>(size));
    path.replace(path.rfind('/') + 1, std::string::npos, kOiioModule);
    void* const module = dlopen(path.c_str(), RTLD_LAZY | RTLD_LOCAL);
    void* const symbol = module ? dlsym(module, kOiioSymbol) : nullptr;
    if (!symbol) throw std::runtime_error(dlerror());
    oiio = static_cast<const OiioCodecs*>(symbol);
}

void run(const Request& request, int input, int output, Reply& reply) {
    const int threads = std::clamp(request.threads, 1, kMaxThreads);
    if (threads > 1) Imf::setGlobalThreadCount(threads);
    const Bytes file = map_input(input);
    const AllocatePixels allocate = [&](std::size_t bytes_per_texel) {
        return map_output(output, static_cast<std::size_t>(reply.width) *
                                      static_cast<std::size_t>(reply.height) * bytes_per_texel);
    };
    const auto check_pixels = [&](std::size_t bytes_per_texel) {
        check_size(request.width, request.height);
        if (request.frames < 1 ||
            file.size() / bytes_per_texel != static_cast<std::size_t>(request.width) *
                                                 static_cast<std::size_t>(request.height) *
                                                 static_cast<std::size_t>(request.frames)) {
            throw Refusal("its pixels do not fill it");
        }
    };
    const auto write_encoded = [&](const std::vector<unsigned char>& bytes) {
        write_all(output, std::as_bytes(std::span(bytes)));
    };
    switch (request.task) {
        case Task::DecodeFloat:
            if (file.empty()) throw Refusal("it is empty");
            if (starts_with(file, kExrMagic)) return decode_exr(file, threads, reply, allocate);
            if (starts_with(file, kRadianceMagic))
                return decode_radiance(file, threads, reply, allocate);
            throw Refusal("neither Radiance .hdr nor OpenEXR");
        case Task::DecodeRgba8:
            if (file.empty()) throw Refusal("it is empty");
            return oiio->decode_rgba8(file, reply, allocate);
        case Task::DecodeDraco:
            limit_memory(most_draco_bytes(file.size()));
            return decode_draco(file, [&](Bytes bytes) { write_all(output, bytes); });
        case Task::EncodePng:
            check_pixels(3);
            return write_encoded(oiio->encode_png(request.width, request.height, file));
        case Task::EncodeGif:
            check_pixels(3);
            return write_encoded(oiio->encode_gif(request.width, request.height, request.frames,
                                                  request.frames_per_second, file));
        case Task::EncodeExr:
            check_pixels(3 * sizeof(float));
            return write_encoded(encode_exr(request.width, request.height, file));
    }
    throw Refusal("an unknown task");
}

/// One line without what the libraries put around it: OpenEXR's `Cannot read image file "". `, and
/// full stops. What cannot be printed becomes '?'.
void set_message(Reply& reply, std::string text) {
    if (const std::size_t end = text.find("\"\". "); end != std::string::npos)
        text.erase(0, end + 4);
    text.resize(std::min(text.find('\n'), text.size()));
    while (!text.empty() && (text.back() == '.' || text.back() == ' ')) text.pop_back();
    if (text.empty()) text = "damaged";
    const std::size_t size = std::min(text.size(), reply.message.size() - 1);
    std::transform(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(size),
                   reply.message.begin(),
                   [](char c) { return std::isprint(static_cast<unsigned char>(c)) ? c : '?'; });
    reply.message[size] = 0;
}

/// The child: does the work, writes what came of it to the reply that it shares with its parent.
[[noreturn]] void run_in_child(const Request& request, int input, int output, Reply& reply) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    limit_memory(0);
    limit_time(std::max(request.milliseconds, 1));
    try {
        run(request, input, output, reply);
        reply.outcome = Outcome::Done;
    } catch (const std::bad_alloc&) {
        set_message(reply, "it takes more memory than a file like it may");
        reply.outcome = Outcome::Refused;
    } catch (const std::exception& e) {
        set_message(reply, e.what());
        reply.outcome = Outcome::Refused;
    }
    _exit(0);  // no destructors: some of the libraries' take their time
}

/// Runs a request in a child of its own; whatever becomes of the child is an outcome.
void serve(const Request& request, int input, int output, Reply& reply) {
    reply = Reply{};
    try {
        if (needs_oiio(request.task)) load_oiio();
    } catch (const std::exception& e) {
        reply.outcome = Outcome::Unable;
        return set_message(reply, e.what());
    }
    const pid_t child = fork();
    if (child == 0) run_in_child(request, input, output, reply);
    if (child < 0) {
        reply.outcome = Outcome::Refused;
        return set_message(reply,
                           std::string("no process for its decoder: ") + std::strerror(errno));
    }
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    reply.magic = kMagic;  // whatever the child has done to it
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return;
    const bool late = WIFSIGNALED(status) && WTERMSIG(status) == SIGALRM;
    reply = Reply{};
    reply.outcome = late ? Outcome::TimedOut : Outcome::Crashed;
}

/// False at the end of the conversation.
bool receive(Request& request, int (&files)[2]) {
    iovec data{&request, sizeof request};
    alignas(cmsghdr) char control[CMSG_SPACE(sizeof files)];
    msghdr message{};
    message.msg_iov = &data;
    message.msg_iovlen = 1;
    message.msg_control = control;
    message.msg_controllen = sizeof control;
    ssize_t size;
    do {
        size = recvmsg(kSocket, &message, MSG_CMSG_CLOEXEC);
    } while (size < 0 && errno == EINTR);
    const cmsghdr* const header = CMSG_FIRSTHDR(&message);
    if (size != sizeof request || request.magic != kMagic || !header ||
        header->cmsg_type != SCM_RIGHTS || header->cmsg_len != CMSG_LEN(sizeof files)) {
        return false;
    }
    std::memcpy(files, CMSG_DATA(header), sizeof files);
    return true;
}

int serve_all() {
    struct stat info {};
    if (fstat(kSocket, &info) != 0 || !S_ISSOCK(info.st_mode)) {
        std::fputs("envbake-image-worker is started by envbake, not by hand\n", stderr);
        return 2;
    }
    const rlimit no_core{0, 0};
    setrlimit(RLIMIT_CORE, &no_core);
    void* const shared =
        mmap(nullptr, sizeof(Reply), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED) return 1;
    Reply& reply = *new (shared) Reply;
    Request request;
    for (int files[2]; receive(request, files);) {
        serve(request, files[0], files[1], reply);
        close(files[0]);
        close(files[1]);
        if (send(kSocket, &reply, sizeof reply, MSG_NOSIGNAL) != sizeof reply) break;
    }
    return 0;
}

}  // namespace
}  // namespace envbake::worker

int main() {
    _exit(envbake::worker::serve_all());  // no destructors, as above
}
