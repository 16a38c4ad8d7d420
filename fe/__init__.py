"""Finite-element samples of specimens: material, contact, equilibrium, response, campaign."""

from fe.campaign import Campaign, CampaignFailed, run_campaign
from fe.dask_executor import dask_map
from fe.executors import process_map, serial_map
from fe.progress import StepReport
from fe.response import Response, Status, load_response, save_response
from fe.simulate import Specimen, simulate
from fe.specimens.block_pin import BlockPin, BlockPinModel, Contact
from fe.specimens.cylinder import Cylinder, CylinderModel
from fe.specimens.tensile import NotchedPlate, TensileModel
from fe.specimens.uniaxial import Bar, UniaxialModel
from fe.vtk_export import export_vtk

__all__ = [
    "Bar",
    "BlockPin",
    "BlockPinModel",
    "Campaign",
    "CampaignFailed",
    "Contact",
    "Cylinder",
    "CylinderModel",
    "NotchedPlate",
    "Response",
    "Specimen",
    "Status",
    "StepReport",
    "TensileModel",
    "UniaxialModel",
    "dask_map",
    "export_vtk",
    "load_response",
    "process_map",
    "run_campaign",
    "save_response",
    "serial_map",
    "simulate",
]
