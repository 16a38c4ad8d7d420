"""Finite element samples of the specimen: material, contact, equilibrium, response, campaign."""

from fe.campaign import Campaign, CampaignFailed, run_campaign
from fe.dask_executor import dask_map
from fe.executors import process_map, serial_map
from fe.response import Response, Status, load_response, save_response
from fe.specimens.block_pin import BlockPin, BlockPinModel, Contact

__all__ = [
    "BlockPin",
    "BlockPinModel",
    "Campaign",
    "CampaignFailed",
    "Contact",
    "Response",
    "Status",
    "dask_map",
    "load_response",
    "process_map",
    "run_campaign",
    "save_response",
    "serial_map",
]
