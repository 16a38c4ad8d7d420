"""Finite-element samples of specimens: material, contact, equilibrium, response, campaign."""

from fe.campaign import (
    CampaignFailed,
    CampaignPlan,
    load_campaign,
    run_campaign,
    run_campaigns,
)
from fe.campaign_parameters import RATIOS, Parameter
from fe.campaign_result import Campaign
from fe.contact import PenaltyLaw
from fe.dask_executor import dask_map, dask_workers
from fe.executors import process_map, serial_map
from fe.fingerprint import NO_PHYSICS
from fe.labelled_response import labelled
from fe.materials import Material, material
from fe.newton import NewtonOptions
from fe.progress import StepReport
from fe.progress_bar import progress_bar
from fe.response import Response, Status, load_response, save_response
from fe.simulate import Specimen, simulate
from fe.specimens.block_pin import BlockPin, BlockPinModel, Contact, Rings
from fe.specimens.block_pin_family import FAMILY, BlockPinFamily
from fe.specimens.cylinder import Cylinder, CylinderModel
from fe.specimens.disc_pin import Disc, DiscPinModel
from fe.specimens.tensile import NotchedPlate, TensileModel
from fe.specimens.uniaxial import Bar, UniaxialModel
from fe.steps import StepOptions
from fe.vtk_export import export_vtk

__all__ = [
    "FAMILY",
    "NO_PHYSICS",
    "RATIOS",
    "Bar",
    "BlockPin",
    "BlockPinFamily",
    "BlockPinModel",
    "Campaign",
    "CampaignFailed",
    "CampaignPlan",
    "Contact",
    "Cylinder",
    "CylinderModel",
    "Disc",
    "DiscPinModel",
    "Material",
    "NewtonOptions",
    "NotchedPlate",
    "Parameter",
    "PenaltyLaw",
    "Response",
    "Rings",
    "Specimen",
    "Status",
    "StepOptions",
    "StepReport",
    "TensileModel",
    "UniaxialModel",
    "dask_map",
    "dask_workers",
    "export_vtk",
    "labelled",
    "load_campaign",
    "load_response",
    "material",
    "process_map",
    "progress_bar",
    "run_campaign",
    "run_campaigns",
    "save_response",
    "serial_map",
    "simulate",
]
