// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/format/error.h"

#include <string_view>

namespace envbake {

/// A rule of docs/format.md, under the number that it has there. Numbers and names never change;
/// those below 100 are format::Errc's.
struct FormatRule {
    int code = 0;
    std::string_view name;

    constexpr FormatRule(int code_, std::string_view name_) : code(code_), name(name_) {}
    explicit FormatRule(format::Errc errc)
        : code(static_cast<int>(errc)), name(format::to_string(errc)) {}
};

/// What arrays and metadata mean. 101 to 103 are not used: each stood for several of these.
namespace rule {
inline constexpr FormatRule kMetadataSyntax{100, "MetadataSyntax"};
inline constexpr FormatRule kNonFinite{104, "NonFinite"};
inline constexpr FormatRule kNegative{105, "Negative"};
inline constexpr FormatRule kSelfTest{110, "SelfTest"};
inline constexpr FormatRule kMetadataObject{120, "MetadataObject"};
inline constexpr FormatRule kMetadataStored{121, "MetadataStored"};
inline constexpr FormatRule kNamesPlaced{122, "NamesPlaced"};
inline constexpr FormatRule kLightsExtracted{130, "LightsExtracted"};
inline constexpr FormatRule kMipsCount{131, "MipsCount"};
inline constexpr FormatRule kMipsLevels{132, "MipsLevels"};
inline constexpr FormatRule kMipsGap{133, "MipsGap"};
inline constexpr FormatRule kMipsBeyondCount{134, "MipsBeyondCount"};
inline constexpr FormatRule kMipsLevel{135, "MipsLevel"};
inline constexpr FormatRule kMipsSize{136, "MipsSize"};
inline constexpr FormatRule kMipsRoughness{137, "MipsRoughness"};
inline constexpr FormatRule kTableAxes{138, "TableAxes"};
inline constexpr FormatRule kMeshesList{139, "MeshesList"};
inline constexpr FormatRule kMeshNumbers{140, "MeshNumbers"};
inline constexpr FormatRule kMeshAbsent{141, "MeshAbsent"};
inline constexpr FormatRule kVertexCount{142, "VertexCount"};
inline constexpr FormatRule kIrradianceUnasked{143, "IrradianceUnasked"};
inline constexpr FormatRule kDiffuseUnasked{144, "DiffuseUnasked"};
inline constexpr FormatRule kAnswersMissing{145, "AnswersMissing"};
inline constexpr FormatRule kQuestionsMissing{146, "QuestionsMissing"};
inline constexpr FormatRule kToleranceMissing{147, "ToleranceMissing"};
inline constexpr FormatRule kToleranceRange{148, "ToleranceRange"};
inline constexpr FormatRule kAnswerCount{149, "AnswerCount"};
inline constexpr FormatRule kVertexAbsent{150, "VertexAbsent"};
inline constexpr FormatRule kSelfTestStored{151, "SelfTestStored"};
inline constexpr FormatRule kNormalMissing{152, "NormalMissing"};
inline constexpr FormatRule kLobeFacts{153, "LobeFacts"};
inline constexpr FormatRule kLobePair{154, "LobePair"};
inline constexpr FormatRule kGlossyBands{155, "GlossyBands"};
inline constexpr FormatRule kNormalLength{156, "NormalLength"};
inline constexpr FormatRule kReflectedAlone{157, "ReflectedAlone"};
inline constexpr FormatRule kReflectedType{158, "ReflectedType"};
inline constexpr FormatRule kReflectedShape{159, "ReflectedShape"};
inline constexpr FormatRule kLightsType{160, "LightsType"};
inline constexpr FormatRule kShType{161, "ShType"};
inline constexpr FormatRule kMipType{162, "MipType"};
inline constexpr FormatRule kTableType{163, "TableType"};
inline constexpr FormatRule kAlbedoType{164, "AlbedoType"};
inline constexpr FormatRule kTransportType{165, "TransportType"};
inline constexpr FormatRule kQuestionType{166, "QuestionType"};
inline constexpr FormatRule kAnswerType{167, "AnswerType"};
inline constexpr FormatRule kEmittedType{168, "EmittedType"};
inline constexpr FormatRule kGlossyType{169, "GlossyType"};
inline constexpr FormatRule kLightsShape{170, "LightsShape"};
inline constexpr FormatRule kShCoefficients{171, "ShCoefficients"};
inline constexpr FormatRule kShChannels{172, "ShChannels"};
inline constexpr FormatRule kMipShape{173, "MipShape"};
inline constexpr FormatRule kTableShape{174, "TableShape"};
inline constexpr FormatRule kAlbedoShape{175, "AlbedoShape"};
inline constexpr FormatRule kTransportShape{176, "TransportShape"};
inline constexpr FormatRule kQuestionShape{177, "QuestionShape"};
inline constexpr FormatRule kAnswerShape{178, "AnswerShape"};
inline constexpr FormatRule kSelfTestEmpty{179, "SelfTestEmpty"};
inline constexpr FormatRule kMipLayout{180, "MipLayout"};
inline constexpr FormatRule kMipChain{181, "MipChain"};
inline constexpr FormatRule kAlbedoRows{182, "AlbedoRows"};
inline constexpr FormatRule kEmittedShape{183, "EmittedShape"};
inline constexpr FormatRule kGlossyShape{184, "GlossyShape"};
inline constexpr FormatRule kNormalShape{185, "NormalShape"};
inline constexpr FormatRule kLobeShape{186, "LobeShape"};
inline constexpr FormatRule kNormalType{187, "NormalType"};
inline constexpr FormatRule kLobeType{188, "LobeType"};
inline constexpr FormatRule kWaveletFaceSize{190, "WaveletFaceSize"};
inline constexpr FormatRule kWaveletStep{191, "WaveletStep"};
inline constexpr FormatRule kWaveletType{192, "WaveletType"};
inline constexpr FormatRule kWaveletShape{193, "WaveletShape"};
inline constexpr FormatRule kWaveletStored{194, "WaveletStored"};
inline constexpr FormatRule kWaveletPair{195, "WaveletPair"};
inline constexpr FormatRule kWaveletIndex{196, "WaveletIndex"};
inline constexpr FormatRule kWaveletOffsets{197, "WaveletOffsets"};
inline constexpr FormatRule kWaveletBlock{198, "WaveletBlock"};
inline constexpr FormatRule kWaveletVertexAbsent{199, "WaveletVertexAbsent"};
inline constexpr FormatRule kRangePair{220, "RangePair"};
inline constexpr FormatRule kRangeType{221, "RangeType"};
inline constexpr FormatRule kRangeShape{222, "RangeShape"};
inline constexpr FormatRule kClustersWhole{223, "ClustersWhole"};
inline constexpr FormatRule kClusterType{224, "ClusterType"};
inline constexpr FormatRule kClusterShape{225, "ClusterShape"};
inline constexpr FormatRule kClusterNumber{226, "ClusterNumber"};
inline constexpr FormatRule kShardPart{230, "ShardPart"};
}  // namespace rule

}  // namespace envbake
