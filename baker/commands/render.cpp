// SPDX-License-Identifier: Apache-2.0
#include "baker/commands/command.h"
#include "baker/commands/progress_printer.h"
#include "baker/core/parallel.h"
#include "baker/core/text.h"
#include "baker/core/write_file.h"
#include "baker/input/image_worker.h"
#include "baker/input/read_environment.h"
#include "baker/input/read_scene.h"
#include "baker/pipeline/file_hash.h"
#include "baker/pipeline/metadata.h"
#include "baker/render/camera.h"
#include "baker/render/compare.h"
#include "baker/render/light_turn.h"
#include "baker/render/preview.h"
#include "baker/render/reference.h"
#include "baker/render/tone_map.h"

#include "envbake/runtime/bundle.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <numbers>
#include <optional>
#include <ostream>
#include <string>
#include <system_error>
#include <vector>

namespace envbake {

namespace {

namespace fs = std::filesystem;

struct RenderOptions {
    fs::path bundle, scene, output, environment;
    std::vector<double> camera, look_at;
    std::optional<double> fov_deg;
    std::vector<int> size{1280, 720};
    int sights_per_axis = 3;
    bool white = false;
    bool split_sum = false;
    std::string basis = "sh";
    double rotate_light_deg = 0;
    int turntable = 0;  ///< pictures; 0: one, of the scene as it is
    std::optional<double> exposure;
    bool reference = false;
    int reference_samples = 256;
    int threads = 0;
    bool quiet = false;
};

/// scene.png -> scene.reference.png
fs::path beside(const fs::path& image, const char* kind) {
    return image.parent_path() /
           concat(image.stem().string(), ".", kind, image.extension().string());
}

Error not_an_image_name(const fs::path& file) {
    return {Errc::Usage, concat(file.string(),
                                ": the name must end in .png or .exr, or for a turntable in "
                                ".gif")};
}

Expected<void> write_display(const fs::path& file, const DisplayPicture& picture) {
    return write_png(file, picture.width, picture.height, picture.rgb);
}

/// .png tone-mapped, .exr as it is.
Expected<void> write_picture(const fs::path& file, const Picture& picture, double exposure) {
    if (file.extension() == ".png") return write_display(file, tone_map(picture, exposure));
    std::vector<float> rgb;
    rgb.reserve(3 * picture.radiance.size());
    for (const Vec3& L : picture.radiance) rgb.insert(rgb.end(), {L.x, L.y, L.z});
    return write_exr(file, picture.width, picture.height, rgb);
}

/// A - b: false colour for .png, signed numbers for .exr.
Expected<void> write_difference(const fs::path& file, const Picture& a, const Picture& b) {
    if (file.extension() == ".png") return write_display(file, difference_picture(a, b));
    Picture difference = a;
    for (std::size_t i = 0; i < a.radiance.size(); ++i) difference.radiance[i] -= b.radiance[i];
    return write_picture(file, difference, 1);
}

/// scene.png -> scene.0007.png
fs::path numbered(const fs::path& image, int k) {
    const std::string digits = std::to_string(k);
    return beside(image,
                  (std::string(4 - std::min<std::size_t>(4, digits.size()), '0') + digits).c_str());
}

/// Whether the turntable is one animated picture.
bool animated(const RenderOptions& options) {
    return options.turntable > 0 && options.output.extension() == ".gif";
}

/// The pictures that the command writes.
std::vector<fs::path> outputs_of(const RenderOptions& options) {
    if (options.turntable > 0 && !animated(options)) {
        std::vector<fs::path> outputs;
        for (int k = 0; k < options.turntable; ++k) outputs.push_back(numbered(options.output, k));
        return outputs;
    }
    if (!options.reference) return {options.output};
    return {options.output, beside(options.output, "reference"),
            beside(options.output, "difference")};
}

Expected<void> check_outputs(const RenderOptions& options, const std::vector<fs::path>& inputs) {
    for (const fs::path& output : outputs_of(options))
        ENVBAKE_TRY_VOID(check_output(output, inputs));
    return {};
}

/// Embree takes coordinates up to 1.8e18 (its FLT_LARGE).
constexpr double kMaxCoordinate = 1e18;
constexpr double kMaxStops = 100;
constexpr double kMinFov = 1, kMaxFov = 170;  // degrees

Expected<void> require_point(const char* option, const std::vector<double>& point) {
    for (const double x : point)
        if (!(std::abs(x) <= kMaxCoordinate))
            return Error{Errc::Usage, concat(option, ": ", x, " is not within +-", kMaxCoordinate)};
    return {};
}

/// What CLI::Range would say, were it not for NaN, which is in every range.
Expected<void> require_in_range(const char* option, const std::optional<double>& value, double low,
                                double high) {
    if (!value || (*value >= low && *value <= high)) return {};
    return Error{Errc::Usage, concat(option, ": ", *value, " is not in ", low, " .. ", high)};
}

/// Everything that can be refused before a file is read.
Expected<void> check_options(const RenderOptions& options) {
    const std::string extension = options.output.extension().string();
    if (extension != ".png" && extension != ".exr" && !animated(options))
        return not_an_image_name(options.output);
    if (options.reference && options.environment.empty())
        return Error{Errc::Usage,
                     "--reference needs the environment that the bundle was baked from: --env"};
    ENVBAKE_TRY_VOID(require_point("--camera", options.camera));
    ENVBAKE_TRY_VOID(require_point("--look-at", options.look_at));
    ENVBAKE_TRY_VOID(require_in_range("--fov", options.fov_deg, kMinFov, kMaxFov));
    ENVBAKE_TRY_VOID(require_in_range("--exposure", options.exposure, -kMaxStops, kMaxStops));
    ENVBAKE_TRY_VOID(require_in_range("--rotate-light", options.rotate_light_deg, -360, 360));
    return check_outputs(options, {options.bundle, options.scene, options.environment});
}

/// An input file as the metadata of a bundle lists it.
struct BakedInput {
    std::string role, name, xxh3;
};

Expected<std::vector<BakedInput>> read_baked_inputs(const fs::path& bundle, const Json& metadata) {
    const Error error{Errc::InvalidBundle,
                      concat(bundle.string(), ": the metadata has no valid list of inputs")};
    std::vector<BakedInput> inputs;
    try {
        const Json& list = metadata.at("inputs");
        if (!list.is_array()) return error;
        for (const Json& input : list)
            inputs.push_back({input.at("role").get<std::string>(),
                              input.at("name").get<std::string>(),
                              input.at("xxh3").get<std::string>()});
    } catch (const Json::exception&) {
        return error;
    }
    return inputs;
}

Error baked_from_another(const fs::path& bundle, const char* role, const fs::path& file) {
    return {Errc::InvalidBundle, concat(bundle.string(), ": was baked from another ", role,
                                        " than ", file.string(), "; bake it again")};
}

/// Refuses a scene or an environment other than the one the bundle was baked from. Its name may be
/// another.
Expected<void> require_same_input(const fs::path& bundle, const std::vector<BakedInput>& inputs,
                                  const char* role, const fs::path& file) {
    ENVBAKE_TRY(const FileHash hash, hash_file(file));
    for (const BakedInput& input : inputs)
        if (input.role == role && input.xxh3 == hash.xxh3) return {};
    return baked_from_another(bundle, role, file);
}

/// Refuses a scene one of whose buffers or images is not what it was.
Expected<void> require_same_resources(const RenderOptions& options,
                                      const std::vector<BakedInput>& inputs, const Scene& scene) {
    for (std::size_t i = 1; i < scene.files_read.size(); ++i) {  // the first is the scene itself
        const fs::path& file = scene.files_read[i];
        ENVBAKE_TRY(const FileHash hash, hash_file(file));
        const Json name = file.lexically_relative(options.scene.parent_path()).generic_string();
        bool same = false;
        for (const BakedInput& input : inputs)  // as text: a name that is no UTF-8 was stored so
            same |= input.role == "resource" && input.xxh3 == hash.xxh3 &&
                    to_text(input.name, -1) == to_text(name, -1);
        if (!same) return baked_from_another(options.bundle, "resource", file);
    }
    return {};
}

/// The truth is of the scene as it was baked: marks given on the command line stand in the
/// metadata alone.
void mark_as_baked(const Json& metadata, Scene& scene) {
    const auto list = metadata.find("meshes");
    if (list == metadata.end() || !list->is_array()) return;
    for (std::size_t i = 0; i < std::min(list->size(), scene.meshes.size()); ++i)
        if ((*list)[i].is_object() && (*list)[i].value("casts", Json()) == false)
            scene.meshes[i].casts = false;
}

Expected<Camera> make_camera(const RenderOptions& options, const Scene& scene,
                             const Tracer& tracer) {
    const int width = options.size[0], height = options.size[1];
    Camera camera = frame_scene(scene, tracer, width, height, options.fov_deg);
    const auto vector = [](const std::vector<double>& v) { return DVec3(v[0], v[1], v[2]); };
    if (!options.camera.empty()) {
        camera.position = vector(options.camera);
        camera.vertical_fov_deg = options.fov_deg.value_or(Camera{}.vertical_fov_deg);
    }
    if (!options.look_at.empty()) camera.target = vector(options.look_at);
    if (!(glm::length(camera.target - camera.position) > 1e-30))
        return Error{Errc::Usage,
                     concat(options.camera.empty() ? "--look-at" : "--camera",
                            ": the camera stands on the point that it looks at (--look-at)")};
    return camera;
}

std::string percent(double fraction) {
    return format_number(100 * fraction) + " %";
}

void print_comparison(const char* with, const Picture& picture, const Picture& reference,
                      double noise, std::ostream& out) {
    const Comparison c = compare(picture, reference);
    out << "against " << with << ": relative RMSE " << percent(c.relative_rmse)
        << ", mean difference " << percent(c.relative_mean_difference) << ", reference noise "
        << percent(noise) << ", " << format_count(c.pixel_count) << " pixels\n";
}

std::vector<Vec3> lighting_of(const runtime::Bundle& bundle, const LightTurn& turn) {
    std::vector<Vec3> coeffs;
    const std::vector<float> values = turn.turned(bundle.lighting());
    for (std::size_t i = 0; i + 2 < values.size(); i += 3)
        coeffs.emplace_back(values[i], values[i + 1], values[i + 2]);
    return coeffs;
}

/// The scene turns counter-clockwise seen from above, once, about the upright through the point
/// that the camera looks at; light and camera stay. To the scene it is they that turn, clockwise.
Expected<void> render_turntable(const RenderOptions& options, const Scene& scene,
                                const Tracer& tracer, const runtime::Bundle& bundle,
                                const Camera& camera, const PreviewOptions& preview_options,
                                Progress& progress) {
    constexpr int kFramesPerSecond = 10;
    std::optional<double> exposure;
    if (options.exposure) exposure = std::exp2(*options.exposure);
    std::vector<std::uint8_t> frames;  // of the animated picture
    for (int k = 0; k < options.turntable; ++k) {
        const double angle = 2 * std::numbers::pi * k / options.turntable;
        Camera orbiting = camera;
        orbiting.position =
            camera.target + LightTurn(-angle).turned(camera.position - camera.target);
        PreviewOptions turned = preview_options;
        turned.light_turn = LightTurn(preview_options.light_turn.radians() - angle);
        ENVBAKE_TRY(const Picture picture,
                    render_preview(scene, tracer, bundle, orbiting, turned, progress));
        if (!exposure) exposure = auto_exposure(picture);  // the same for all: no flicker
        if (animated(options)) {
            const DisplayPicture frame = tone_map(picture, *exposure);
            frames.insert(frames.end(), frame.rgb.begin(), frame.rgb.end());
        } else {
            ENVBAKE_TRY_VOID(write_picture(numbered(options.output, k), picture, *exposure));
        }
    }
    if (!animated(options)) return {};
    return write_gif(options.output, camera.width, camera.height, options.turntable,
                     kFramesPerSecond, frames);
}

Expected<void> render(const RenderOptions& options, std::ostream& out, std::ostream& err) {
    ENVBAKE_TRY_VOID(check_options(options));
    start_image_worker();
    const ThreadLimit limit(options.threads);
    Progress progress;
    std::optional<ProgressPrinter> printer;
    if (!options.quiet) printer.emplace(progress, err);

    const auto bundle = runtime::Bundle::open(options.bundle.c_str());
    if (!bundle) {
        const bool system = bundle.error().system_error != 0;
        return Error{system ? Errc::Failed : Errc::InvalidBundle,
                     concat(options.bundle.string(), ": ", format::to_string(bundle.error()))};
    }
    const Json metadata = parse_metadata(bundle->reader().metadata());
    ENVBAKE_TRY(const std::vector<BakedInput> inputs, read_baked_inputs(options.bundle, metadata));
    ENVBAKE_TRY_VOID(require_same_input(options.bundle, inputs, "scene", options.scene));
    if (!options.environment.empty())
        ENVBAKE_TRY_VOID(
            require_same_input(options.bundle, inputs, "environment", options.environment));
    ENVBAKE_TRY(Scene scene, read_scene(options.scene));
    mark_as_baked(metadata, scene);
    ENVBAKE_TRY_VOID(check_outputs(options, scene.files_read));
    ENVBAKE_TRY_VOID(require_same_resources(options, inputs, scene));
    std::optional<Environment> environment;
    if (options.reference) {
        ENVBAKE_TRY(environment, read_environment(options.environment));
    }
    ENVBAKE_TRY(const Tracer tracer, Tracer::build(scene));
    ENVBAKE_TRY(const Camera camera, make_camera(options, scene, tracer));
    constexpr double kDegree = std::numbers::pi / 180;
    const LightTurn turn(options.rotate_light_deg * kDegree);
    const PreviewOptions preview_options{.sights_per_axis = options.sights_per_axis,
                                         .white_lambert = options.white,
                                         .split_sum = options.split_sum,
                                         .light_turn = turn,
                                         .wavelets = options.basis == "wavelet"};
    if (options.turntable > 0)
        return render_turntable(options, scene, tracer, *bundle, camera, preview_options, progress);
    ENVBAKE_TRY(const Picture picture,
                render_preview(scene, tracer, *bundle, camera, preview_options, progress));
    const double exposure =
        options.exposure ? std::exp2(*options.exposure) : auto_exposure(picture);
    if (!environment) return write_picture(options.output, picture, exposure);

    const std::vector<Vec3> lighting = lighting_of(*bundle, turn);
    ReferenceOptions reference_options;
    reference_options.samples_per_pixel = options.reference_samples;
    reference_options.sights_per_axis = options.sights_per_axis;
    reference_options.white_lambert = options.white;
    reference_options.light_turn = turn;
    if (options.white && !preview_options.wavelets) reference_options.truncated_light = lighting;
    const Reference reference =
        render_reference(scene, tracer, *environment, camera, reference_options, progress);
    printer.reset();
    print_comparison("the reference", picture, reference.picture, reference.noise_rms, out);
    if (reference.truncated)
        print_comparison(concat("the same light in ", bundle->lighting().bands, " bands").c_str(),
                         picture, *reference.truncated, reference.truncated_noise_rms, out);
    ENVBAKE_TRY_VOID(write_picture(options.output, picture, exposure));
    ENVBAKE_TRY_VOID(
        write_picture(beside(options.output, "reference"), reference.picture, exposure));
    return write_difference(beside(options.output, "difference"), picture, reference.picture);
}

}  // namespace

RunCommand declare_render(CLI::App& app) {
    const auto options = std::make_shared<RenderOptions>();
    app.add_option("bundle", options->bundle, "Bundle (.envb)")->required();
    app.add_option("scene", options->scene, "The scene it was baked from (.glb, .gltf)")
        ->required();
    app.add_option("-o,--output", options->output,
                   "Picture to write: .png tone-mapped, .exr linear; .gif a turntable that moves")
        ->required();
    app.add_option("--camera", options->camera,
                   "Camera position X,Y,Z in metres; default: frames the scene")
        ->expected(3)
        ->delimiter(',');
    app.add_option("--look-at", options->look_at, "Point X,Y,Z in the middle of the picture")
        ->expected(3)
        ->delimiter(',');
    app.add_option("--fov", options->fov_deg,
                   "Vertical field of view, 1 to 170 degrees; default: 35, or 55 where the framing "
                   "stands in a room");
    app.add_option("--size", options->size, "Picture size WxH in pixels")
        ->expected(2)
        ->delimiter('x')
        ->default_str("1280x720")
        ->check(CLI::Range(1, 16384));
    app.add_option("--sights", options->sights_per_axis,
                   "Lines of sight through a pixel, along each axis")
        ->capture_default_str()
        ->check(CLI::Range(1, 16));
    app.add_option("--exposure", options->exposure,
                   "Exposure of the .png in stops, -100 to 100; default: by the picture");
    app.add_option("--rotate-light", options->rotate_light_deg,
                   "Turn the light about +Y by -360 to 360 degrees, counter-clockwise from above")
        ->capture_default_str();
    CLI::Option* turntable =
        app.add_option("--turntable", options->turntable,
                       "Write N pictures, IMAGE.0000 and on, or N frames of a .gif: the scene "
                       "turns once before the camera, the light stays")
            ->check(CLI::Range(1, 9999));
    app.add_flag("--white", options->white,
                 "White paper in place of every material: the diffuse part alone");
    app.add_flag("--split-sum", options->split_sum,
                 "Specular from mips and BRDF table even where there is glossy transport");
    app.add_option("--basis", options->basis,
                   "What carries diffuse light: sh, or wavelet where --wavelet was baked")
        ->capture_default_str()
        ->check(CLI::IsMember({"sh", "wavelet"}));
    app.add_option("--env", options->environment,
                   "The environment it was baked from; for --reference");
    app.add_flag(
           "--reference", options->reference,
           "Also trace the truth: writes IMAGE.reference and IMAGE.difference, prints the error")
        ->excludes(turntable);
    app.add_option("--reference-samples", options->reference_samples, "Light samples a pixel")
        ->capture_default_str()
        ->check(CLI::Range(2, 1 << 20));
    app.add_option("--threads", options->threads, "Threads; 0 uses every core")
        ->capture_default_str()
        ->check(CLI::Range(0, 4096));
    app.add_flag("-q,--quiet", options->quiet, "Print no progress");
    return [options](std::ostream& out, std::ostream& err) {
        const auto done = render(*options, out, err);
        return done ? ExitCode::Done : report(done.error(), err);
    };
}

}  // namespace envbake
