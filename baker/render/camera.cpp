// SPDX-License-Identifier: Apache-2.0
#include "baker/render/camera.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

namespace envbake {
namespace {

constexpr double kPi = std::numbers::pi;

struct Axes {
    DVec3 forward, right, up;
};

Axes axes_looking(const DVec3& forward) {
    const DVec3 upright = std::abs(forward.y) < 0.9999 ? DVec3(0, 1, 0) : DVec3(0, 0, -1);
    const DVec3 right = glm::normalize(glm::cross(forward, upright));
    return {forward, right, glm::cross(right, forward)};
}

struct Bounds {
    DVec3 low{std::numeric_limits<double>::infinity()};
    DVec3 high{-std::numeric_limits<double>::infinity()};
    bool empty() const { return !(low.x <= high.x); }
    DVec3 size() const { return high - low; }
};

template <class Visit>
void for_each_referenced_position(const Scene& scene, const Visit& visit) {
    for (const Mesh& mesh : scene.meshes) {
        for (const std::uint32_t vertex : mesh.triangles) visit(DVec3(mesh.positions[vertex]));
    }
}

/// The closest pinhole position with the given axes that has every point within the four planes of
/// slopes tan_x and tan_y. Along each picture axis the two planes that touch the points meet in a
/// line; the camera stands on the line that lies further back and is centred between the planes of
/// the other axis.
DVec3 tight_position(const Scene& scene, const Axes& axes, double tan_x, double tan_y) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    // A point is inside when |x| <= tan (z - z_camera): bounds on c = x_camera and z_camera.
    double right = -kInfinity, left = -kInfinity, top = -kInfinity, bottom = -kInfinity;
    for_each_referenced_position(scene, [&](const DVec3& p) {
        const double x = glm::dot(p, axes.right), y = glm::dot(p, axes.up);
        const double z = glm::dot(p, axes.forward);
        right = std::max(right, x - tan_x * z);
        left = std::max(left, -x - tan_x * z);
        top = std::max(top, y - tan_y * z);
        bottom = std::max(bottom, -y - tan_y * z);
    });
    const double z = std::min(-(right + left) / (2 * tan_x), -(top + bottom) / (2 * tan_y));
    return (right - left) / 2 * axes.right + (top - bottom) / 2 * axes.up + z * axes.forward;
}

bool shows_back(const Scene& scene, const Hit& hit, const DVec3& direction) {
    const Mesh& mesh = scene.meshes[hit.mesh];
    const Material& material = scene.materials[static_cast<std::size_t>(mesh.material)];
    return !material.double_sided && glm::dot(DVec3(hit.geometric_normal), direction) > 0;
}

/// Share of the rays of a coarse picture that meet the hidden side of a surface first.
double back_share(const Scene& scene, const Tracer& tracer, const Camera& camera) {
    const CameraRays rays(camera);
    constexpr int kRays = 32;
    int hits = 0, backs = 0;
    for (int i = 0; i < kRays * kRays; ++i) {
        const DVec3 direction = rays.towards((i % kRays + 0.5) * camera.width / kRays,
                                             (i / kRays + 0.5) * camera.height / kRays);
        const auto hit = tracer.closest(camera.position, direction);
        if (!hit) continue;
        ++hits;
        if (shows_back(scene, *hit, direction)) ++backs;
    }
    return hits == 0 ? 0 : static_cast<double>(backs) / hits;
}

struct View {
    DVec3 position, direction;
    double length = 0;  ///< of the free line of sight, m
};

/// The longest horizontal line of sight among a grid of places inside the bounds that see no hidden
/// side of anything, looked at slightly downwards from its end. None where nothing stands further
/// than a thousandth of the bounds from any of them: above a lone floor seen from behind.
std::optional<View> longest_inside_view(const Scene& scene, const Tracer& tracer,
                                        const Bounds& bounds) {
    constexpr int kAcross = 7, kUp = 3, kAzimuths = 32;
    const double least = 1e-3 * glm::length(bounds.size());
    std::optional<View> best;
    for (int cell = 0; cell < kAcross * kUp * kAcross; ++cell) {
        const DVec3 share((cell % kAcross + 0.5) / kAcross,
                          0.3 + 0.4 * (cell / kAcross % kUp) / (kUp - 1),
                          (cell / (kAcross * kUp) + 0.5) / kAcross);
        const DVec3 place = bounds.low + share * bounds.size();
        std::vector<double> free(kAzimuths, 0.0);
        bool inside = true;
        for (int a = 0; a < kAzimuths && inside; ++a) {
            const double phi = 2 * kPi * a / kAzimuths;
            const DVec3 direction(std::cos(phi), 0, std::sin(phi));
            const auto hit = tracer.closest(place, direction);
            if (!hit) continue;  // a window or a missing wall: nothing to look at
            inside = !shows_back(scene, *hit, direction);
            free[static_cast<std::size_t>(a)] = hit->distance;
        }
        if (!inside) continue;
        for (std::size_t a = 0; a < kAzimuths; ++a) {
            // Both neighbours count too: a gap between two columns is not a view.
            const double length = std::min({free[a], 1.5 * free[(a + 1) % kAzimuths],
                                            1.5 * free[(a + kAzimuths - 1) % kAzimuths]});
            if (!(length > (best ? best->length * 1.0001 : least))) continue;
            const double phi = 2 * kPi * static_cast<double>(a) / kAzimuths;
            best = View{place, DVec3(std::cos(phi), 0, std::sin(phi)), length};
        }
    }
    return best;
}

}  // namespace

CameraRays::CameraRays(const Camera& camera)
    : position_(camera.position),
      width_(camera.width),
      height_(camera.height),
      tan_x_(0),
      tan_y_(std::tan(camera.vertical_fov_deg * kPi / 360)) {
    const Axes axes = axes_looking(glm::normalize(camera.target - camera.position));
    forward_ = axes.forward;
    right_ = axes.right;
    up_ = axes.up;
    tan_x_ = tan_y_ * width_ / height_;
}

DVec3 CameraRays::towards(double x, double y) const {
    return glm::normalize(forward_ + (2 * x / width_ - 1) * tan_x_ * right_ +
                          (1 - 2 * y / height_) * tan_y_ * up_);
}

bool CameraRays::project(const DVec3& point, DVec2& pixel) const {
    const DVec3 offset = point - position_;
    const double depth = glm::dot(offset, forward_);
    if (!(depth > 0)) return false;
    pixel = {(1 + glm::dot(offset, right_) / (depth * tan_x_)) * width_ / 2,
             (1 - glm::dot(offset, up_) / (depth * tan_y_)) * height_ / 2};
    return true;
}

Camera frame_scene(const Scene& scene, const Tracer& tracer, int width, int height,
                   std::optional<double> vertical_fov_deg) {
    Camera camera;
    camera.vertical_fov_deg = vertical_fov_deg.value_or(35);
    camera.width = width;
    camera.height = height;
    Bounds bounds;
    for_each_referenced_position(scene, [&](const DVec3& p) {
        bounds.low = glm::min(bounds.low, p);
        bounds.high = glm::max(bounds.high, p);
    });
    if (bounds.empty()) return camera;
    const DVec3 centre = (bounds.low + bounds.high) / 2.0;

    constexpr double kAzimuth = 35 * kPi / 180, kElevation = 11 * kPi / 180, kMargin = 0.04;
    const Axes axes =
        axes_looking(-DVec3(std::sin(kAzimuth) * std::cos(kElevation), std::sin(kElevation),
                            std::cos(kAzimuth) * std::cos(kElevation)));
    const double tan_y = std::tan(camera.vertical_fov_deg * kPi / 360) * (1 - 2 * kMargin);
    camera.position = tight_position(scene, axes, tan_y * width / height, tan_y);
    // A scene without any depth (a point) would put the camera on it.
    const double depth = glm::dot(centre - camera.position, axes.forward);
    const double least = 1e-3 * std::max(glm::length(bounds.size()), 1e-6);
    if (depth < least) camera.position -= (least - depth) * axes.forward;
    camera.target = camera.position + std::max(depth, least) * axes.forward;

    if (back_share(scene, tracer, camera) > 0.5) {
        if (const auto view = longest_inside_view(scene, tracer, bounds)) {
            const DVec3 back = -view->direction;
            const auto wall = tracer.closest(view->position, back);
            const double step_back = wall ? 0.85 * static_cast<double>(wall->distance) : 0.0;
            camera.vertical_fov_deg = vertical_fov_deg.value_or(55);
            camera.position = view->position + step_back * back;
            camera.target = camera.position + (step_back + view->length) * view->direction;
        }
    }
    return camera;
}

}  // namespace envbake
