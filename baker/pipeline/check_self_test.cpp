// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/check_self_test.h"

#include "baker/core/error.h"

#include "envbake/runtime/glossy.h"
#include "envbake/runtime/shade.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

namespace envbake {

namespace {

using runtime::Rgb;

/// Question i to the runtime's answer.
using Answer = std::function<Rgb(std::size_t)>;

class SelfTestCheck {
  public:
    SelfTestCheck(const runtime::Bundle& bundle, double tolerance)
        : bundle_(bundle), tolerance_(tolerance) {}

    std::vector<std::string> run() {
        ask_irradiance();
        ask_diffuse();
        ask_wavelet();
        ask_specular(runtime::Distribution::Ggx, "selftest/specular/input",
                     "selftest/specular/value");
        ask_specular(runtime::Distribution::Beckmann, "selftest/specular_beckmann/input",
                     "selftest/specular_beckmann/value");
        ask_glossy(runtime::Distribution::Ggx, "selftest/glossy/");
        ask_glossy(runtime::Distribution::Beckmann, "selftest/glossy_beckmann/");
        return std::move(failures_);
    }

  private:
    template <class T>
    std::optional<std::span<const T>> questions(const char* name, std::uint64_t columns) {
        const auto info = bundle_.reader().find(name);
        if (!info) return std::nullopt;
        const auto values = bundle_.reader().view<T>(name);
        if (!values || info->rank != 2 || info->shape[1] != columns) {
            failures_.push_back(concat("array ", name, ": not questions of ", columns, " columns"));
            return std::nullopt;
        }
        return *values;
    }

    void compare(const char* name, std::size_t count, const Answer& answer) {
        const auto values = questions<float>(name, 3);
        if (!values || values->size() != 3 * count) {
            failures_.push_back(concat("array ", name, ": not one answer for each question"));
            return;
        }
        double largest = 0;
        for (const float value : *values)
            largest = std::max(largest, std::abs(static_cast<double>(value)));
        std::size_t wrong = 0;
        for (std::size_t i = 0; i < count; ++i) {
            const Rgb given = answer(i);
            bool good = true;
            for (std::size_t c = 0; c < 3; ++c) {
                const double expected = (*values)[3 * i + c];
                good = good && std::abs(given[c] - expected) <=
                                   tolerance_ * (std::abs(expected) + 1e-3 * largest);
            }
            wrong += good ? 0 : 1;
        }
        if (wrong > 0)
            failures_.push_back(concat("array ", name, ": the runtime gives another answer to ",
                                       wrong, " of ", count, " questions"));
    }

    void ask_irradiance() {
        const auto normals = questions<float>("selftest/irradiance/normal", 3);
        if (!normals) return;
        compare("selftest/irradiance/value", normals->size() / 3, [&](std::size_t i) {
            const float* n = normals->data() + 3 * i;
            return runtime::irradiance(bundle_.lighting(), {n[0], n[1], n[2]});
        });
    }

    void ask_diffuse() {
        const auto vertices = questions<std::uint32_t>("selftest/diffuse/vertex", 2);
        if (!vertices) return;
        compare("selftest/diffuse/value", vertices->size() / 2, [&](std::size_t i) {
            Rgb radiance{};
            const std::uint32_t mesh = (*vertices)[2 * i], vertex = (*vertices)[2 * i + 1];
            if (mesh < bundle_.meshes().size())
                runtime::diffuse_exit(bundle_.meshes()[mesh].diffuse, bundle_.lighting(), vertex,
                                      {&radiance, 1});
            return radiance;
        });
    }

    void ask_wavelet() {
        const auto vertices = questions<std::uint32_t>("selftest/wavelet/vertex", 2);
        if (!vertices) return;
        compare("selftest/wavelet/value", vertices->size() / 2, [&](std::size_t i) {
            Rgb radiance{};
            const std::uint32_t mesh = (*vertices)[2 * i], vertex = (*vertices)[2 * i + 1];
            if (mesh < bundle_.meshes().size())
                runtime::diffuse_exit(bundle_.meshes()[mesh].wavelet,
                                      bundle_.wavelet_lighting().terms, vertex, {&radiance, 1});
            return radiance;
        });
    }

    void ask_specular(runtime::Distribution distribution, const char* input, const char* value) {
        const auto inputs = questions<float>(input, 8);
        if (!inputs) return;
        compare(value, inputs->size() / 8, [&](std::size_t i) {
            const float* q = inputs->data() + 8 * i;
            return runtime::specular(bundle_, distribution, {q[0], q[1], q[2]}, {q[3], q[4], q[5]},
                                     q[6], {q[7], q[7], q[7]});
        });
    }

    void ask_glossy(runtime::Distribution distribution, const std::string& group) {
        const auto vertices = questions<std::uint32_t>((group + "vertex").c_str(), 2);
        const auto inputs = questions<float>((group + "input").c_str(), 5);
        if (!vertices || !inputs || vertices->size() / 2 != inputs->size() / 5) return;
        const runtime::LobeView& lobe = bundle_.glossy_lobe(distribution);
        const auto light =
            std::make_unique<runtime::GlossyLight>(bundle_.lighting(), lobe.light_bands);
        compare((group + "value").c_str(), inputs->size() / 5, [&](std::size_t i) {
            const std::uint32_t mesh = (*vertices)[2 * i], vertex = (*vertices)[2 * i + 1];
            const float* q = inputs->data() + 5 * i;
            if (mesh >= bundle_.meshes().size()) return Rgb{};
            return runtime::reflect(lobe, light->transfer(bundle_.meshes()[mesh], vertex), q[3],
                                    {q[4], q[4], q[4]})
                .radiance({q[0], q[1], q[2]});
        });
    }

    const runtime::Bundle& bundle_;
    double tolerance_;
    std::vector<std::string> failures_;
};

}  // namespace

std::vector<std::string> check_self_test(const format::Reader& reader, double tolerance) {
    const auto bundle = runtime::Bundle::open(reader.file());
    if (!bundle)
        return {concat("the runtime refuses the bundle: ", format::to_string(bundle.error()))};
    return SelfTestCheck(*bundle, tolerance).run();
}

}  // namespace envbake
